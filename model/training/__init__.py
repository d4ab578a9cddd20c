"""Training: loops, losses, checkpoints, the log."""
