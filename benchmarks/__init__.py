"""What the figures in benchmarks/RESULTS.md come from: `make bench`."""
