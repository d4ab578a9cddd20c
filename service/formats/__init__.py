"""File formats of points, surfaces and weights: pure functions from arrays to bytes and back."""
