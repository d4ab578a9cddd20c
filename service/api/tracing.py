"""Traces of requests: FastAPI makes the spans."""

import logging

from fastapi.telemetry import TelemetryConfig

from service.telemetry.tracing import is_installed, is_wanted

logger = logging.getLogger("hof")


def telemetry() -> TelemetryConfig:
    """Return FastAPI's configuration: spans only; metrics are at /metrics and errors in the log."""
    if is_wanted() and not is_installed():
        logger.warning(
            "OTEL_EXPORTER_OTLP_ENDPOINT is set, but traces need an extra: pip install '.[otel]' in the source folder"
        )
    return {"auto_configure": is_installed(), "tracing": is_installed(), "metrics": False, "logs": False}
