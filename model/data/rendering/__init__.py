"""Render views of meshes and sample points on their surfaces."""
