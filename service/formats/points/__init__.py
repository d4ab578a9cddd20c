"""Point clouds as files, one module per format."""
