"""File formats of points, surfaces and weights: pure functions from arrays to bytes and back.

`points.registry`, `mesh.registry` and `weights` list the formats; README.md in this folder says how to add one.
"""
