"""Mesh file formats: what trimesh leaves out or misreads, one format a file."""
