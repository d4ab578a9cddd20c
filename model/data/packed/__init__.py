"""Data sets as a few large files, read with torch, NumPy and Pillow alone."""
