"""Training with data, augmentation and optimizer all on one device. Needs torch, NumPy and Pillow alone."""
