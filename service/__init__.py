"""The HTTP service and the `hof` command: photos in, mapping functions out. Never imports torch."""

__version__ = "0.1.0"
