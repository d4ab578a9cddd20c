"""Training runs: steps, losses, checkpoints."""
