"""Objects made by rule, for training only."""
