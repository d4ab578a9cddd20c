"""Random procedural objects, for training only."""
