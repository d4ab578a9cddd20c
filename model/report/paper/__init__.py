"""PAPER.md: the experiments of the paper on our data, written from their records alone."""
