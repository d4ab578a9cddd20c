"""Training examples from meshes: sources, renderer, deduplication, split, batches."""
