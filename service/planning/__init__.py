"""Collision-free paths around an object: an occupancy grid of its points, a search in it, and waypoints."""
