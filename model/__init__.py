"""Training side: data, networks, losses, evaluation and export. Needs the extra `train`."""
