"""Traces by OpenTelemetry: FastAPI creates the spans; the extra `otel` and the OTEL_* variables export them."""

import importlib.util
import os


def is_installed() -> bool:
    """Return whether the extra `otel` is installed."""
    return importlib.util.find_spec("opentelemetry.exporter") is not None


def is_wanted() -> bool:
    """Return whether the environment names a collector."""
    return any(os.environ.get(f"OTEL_EXPORTER_OTLP_{name}") for name in ("ENDPOINT", "TRACES_ENDPOINT"))
