"""Image files as containers: one module a type, which keeps what the pixels need and drops the metadata."""
