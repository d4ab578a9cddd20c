"""From meshes to training examples: sources, renderer, deduplication, split, batches."""
