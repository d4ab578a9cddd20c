"""Inputs small enough for a test: models, data sets, clouds, meshes."""
