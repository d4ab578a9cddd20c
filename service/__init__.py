"""The HTTP service and the `hof` command: photos in, mapping functions out. Never imports torch."""

import os

__version__ = "0.2.0.dev0"

# onnxruntime's wheels send events about sessions to their maker, and keep an id for that in the user's cache, unless
# this is set before onnxruntime starts (its Privacy.md; seen with 1.31.1).
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
