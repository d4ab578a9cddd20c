"""Other servers of the same model, each a program with POST /encode; benchmarks.load.beside_peers runs them."""
