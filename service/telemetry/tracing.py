"""Traces by OpenTelemetry: FastAPI creates the spans; the extra `otel` and the OTEL_* variables export them."""

import importlib.util
import logging
import os

from fastapi.telemetry import TelemetryConfig

logger = logging.getLogger("hof")


def is_installed() -> bool:
    """Return whether the extra `otel` is installed."""
    return importlib.util.find_spec("opentelemetry.exporter") is not None


def is_wanted() -> bool:
    """Return whether the environment names a collector."""
    return any(os.environ.get(f"OTEL_EXPORTER_OTLP_{name}") for name in ("ENDPOINT", "TRACES_ENDPOINT"))


def telemetry() -> TelemetryConfig:
    """Return FastAPI's configuration: spans only; metrics are at /metrics and errors in the log."""
    if is_wanted() and not is_installed():
        logger.warning(
            "OTEL_EXPORTER_OTLP_ENDPOINT is set, but traces need an extra: pip install '.[otel]' in the source folder"
        )
    return {"auto_configure": is_installed(), "tracing": is_installed(), "metrics": False, "logs": False}
