"""Other servers of the same model: each a program that serves POST /encode; benchmarks.comparison runs them."""
