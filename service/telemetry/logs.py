"""The log: a line an event on stderr, as JSON or as text, each with the id of the request that it belongs to."""

import json
import logging
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Any, Final

from opentelemetry import trace

from service.settings import LogFormat

# Set once a request, and never reset: what the server logs about it after its end has the id, too.
REQUEST_ID: Final[ContextVar[str | None]] = ContextVar("hof_request_id", default=None)


def configuration(log_format: LogFormat, level: str) -> dict[str, Any]:
    """For logging.config.dictConfig: everything of this process goes to stderr in one format."""
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
    """A JSON object a line; `fields` of a record (logging's `extra`) become its members."""

    def format(self, record: logging.LogRecord) -> str:
        """time (RFC 3339, UTC), level, message, pid, request_id, trace_id, the fields, and of an error its trace."""
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
    """Time, level and message, and the request's id where there is one; of an error its trace below it."""

    def format(self, record: logging.LogRecord) -> str:
        """The lines of a record."""
        line = f"{_time(record)} {record.levelname.lower()} {record.getMessage()}"
        line += "".join(f" {name}={value}" for name, value in _correlation().items())
        return f"{line}\n{self.formatException(record.exc_info)}" if record.exc_info else line


def _time(record: logging.LogRecord) -> str:
    return datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _correlation() -> dict[str, str]:
    """By what a line is found again: its request's id, and where requests are traced the trace's."""
    request_id, span = REQUEST_ID.get(), trace.get_current_span().get_span_context()
    told = {} if request_id is None else {"request_id": request_id}
    return told | ({"trace_id": f"{span.trace_id:032x}"} if span.is_valid else {})
