"""The log: one line per event on stderr, as JSON or text, with the id of its request."""

import json
import logging
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Any, Final

from opentelemetry import trace

from service.settings import LogFormat

# Set once per request and never reset, so that what the server logs after the request's end has the id too.
REQUEST_ID: Final[ContextVar[str | None]] = ContextVar("hof_request_id", default=None)


def configuration(log_format: LogFormat, level: str) -> dict[str, Any]:
    """Return a configuration for logging.config.dictConfig: this process logs to stderr in one format."""
    formatters = {"json": "service.telemetry.logs.JsonLines", "text": "service.telemetry.logs.TextLines"}
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "formatters": {"lines": {"()": formatters[log_format]}},
        "handlers": {"stderr": {"class": "logging.StreamHandler", "formatter": "lines"}},
        "root": {"handlers": ["stderr"], "level": "WARNING"},
        "loggers": {name: {"level": level.upper()} for name in ("hof", "uvicorn", "uvicorn.error")},
    }


class JsonLines(logging.Formatter):
    """One JSON object per line; `fields` of a record (logging's `extra`) become its members."""

    def format(self, record: logging.LogRecord) -> str:
        """Return time (RFC 3339, UTC), level, message, pid, request_id, trace_id, fields and an error's stack trace."""
        line: dict[str, Any] = {
            "time": _time(record),
            "level": record.levelname.lower(),
            "message": record.getMessage(),
        }
        line["pid"] = record.process
        line |= _correlation() | getattr(record, "fields", {})
        if record.exc_info:
            line["trace"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class TextLines(logging.Formatter):
    """Time, level, message and correlation ids; an error's stack trace on the lines below."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the lines of a record."""
        line = f"{_time(record)} {record.levelname.lower()} {record.getMessage()}"
        line += "".join(f" {name}={value}" for name, value in _correlation().items())
        return f"{line}\n{self.formatException(record.exc_info)}" if record.exc_info else line


def _time(record: logging.LogRecord) -> str:
    return datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _correlation() -> dict[str, str]:
    """Return the correlation ids (request, trace) of a log line."""
    request_id, span = REQUEST_ID.get(), trace.get_current_span().get_span_context()
    ids = {} if request_id is None else {"request_id": request_id}
    return ids | ({"trace_id": f"{span.trace_id:032x}"} if span.is_valid else {})
