"""Pictures of point clouds and surfaces."""
