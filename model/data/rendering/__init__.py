"""Views and surface points of meshes."""
