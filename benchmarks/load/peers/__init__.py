"""Other servers of the same model: each a program that serves POST /encode; benchmarks.load.beside_peers runs them."""
