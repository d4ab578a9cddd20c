"""`hof doctor`: check an installation; one line per check, with a remedy for each fault."""

import asyncio
import os
import shutil
import socket
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from service.api.middleware.access import keys_of
from service.api.routes.viewer import BUNDLE, NOT_BUILT
from service.encoding import compiled as pixels
from service.encoding.matting import Matting
from service.encoding.registry import Models
from service.errors import HofError
from service.mapping import compiled
from service.settings import MIB, Settings, available_cpus
from service.storage import database
from service.telemetry import tracing

State = Literal["ok", "warn", "fail"]

LOW_DISK: Final = 1024 * MIB  # warns
FULL_DISK: Final = 64 * MIB  # fails
LOCAL: Final = ("127.0.0.1", "::1", "localhost")


@dataclass(frozen=True)
class Finding:
    """The result of a check: `warn` if the service runs with limits, `fail` if it does not run."""

    state: State
    subject: str
    message: str

    def __str__(self) -> str:
        return f"{self.state:<5}{self.subject:<10}{self.message}"


def examine(settings: Settings) -> Iterator[Finding]:
    """Yield each finding as soon as its check ends. A check that raises has failed; the others still run."""
    for subject, check in CHECKS.items():
        try:
            state, message = check(settings)
        except (HofError, OSError) as error:
            state, message = "fail", str(error)
        yield Finding(state, subject, message)


def _model(settings: Settings) -> tuple[State, str]:
    models = Models.open(settings.model, settings.threads)
    models.warm_up()
    names = (f"{encoder.name} ({path})" for encoder, path in zip(models, settings.model, strict=True))
    return "ok", f"encodes: {', '.join(names)}"


def _matting(settings: Settings) -> tuple[State, str]:
    if Matting.of(settings.matting_model, settings.threads) is None:
        return (
            "warn",
            "none: photos need a plain background or transparency; leave out --matting-model to use the shipped one",
        )
    return "ok", str(settings.matting_model)


def _database(settings: Settings) -> tuple[State, str]:
    """Open the database and read all of it; create and migrate nothing."""
    address = database.parse(settings.database_url)
    if address.file and not address.file.exists():
        return _missing_file(address.file.absolute())
    schema = asyncio.run(database.examine(settings.database_url, settings.database_timeout_s))
    message = f"{address.shown} can be read and written"
    if schema.is_empty:
        message += "; it is empty, and `hof serve` will create its tables"
    elif schema.is_older:
        message += "; an older version of hof wrote it, and `hof serve` will migrate it: make a backup first"
    return "ok", message


def _missing_file(path: Path) -> tuple[State, str]:
    """Return whether `hof serve` could create a database file."""
    folder = next(parent for parent in path.parents if parent.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        return "fail", f"cannot create {path}: {folder} is not a folder that hof can write; name another file"
    return "ok", f"{path} will be created"


def _address(settings: Settings) -> tuple[State, str]:
    """Listen as `hof serve` does, for a moment."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        with socket.socket(family) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((settings.host, settings.port))
    except OSError as error:
        return "fail", f"cannot listen on {settings.host} port {settings.port}: {error.strerror}; set --host or --port"
    return "ok", f"{settings.host} port {settings.port} is free"


def _disk(settings: Settings) -> tuple[State, str]:
    file = database.parse(settings.database_url).file
    if file is None:
        return "ok", "not checked: it is the database server's"
    folder = next(parent for parent in file.absolute().parents if parent.is_dir())
    free = shutil.disk_usage(folder).free
    state: State = "fail" if free < FULL_DISK else "warn" if free < LOW_DISK else "ok"
    return state, f"{free // MIB:,} MiB free in {folder}" + (
        "" if state == "ok" else ": free some space, or move the database"
    )


def _page(settings: Settings) -> tuple[State, str]:
    return ("ok", "built") if BUNDLE.is_dir() else ("warn", f"/ and /docs are missing: {NOT_BUILT}")


def _keys(settings: Settings) -> tuple[State, str]:
    keys = keys_of(settings)
    if keys is not None:
        return "ok", f"{len(keys)} in {settings.api_keys_file}"
    if settings.host in LOCAL:
        return "ok", f"none: anyone on this machine may call {settings.host}"
    return "warn", f"none: anyone who reaches {settings.host} may call; `hof key` creates one for --api-keys-file"


def _threads(settings: Settings) -> tuple[State, str]:
    threads, cpus = settings.workers * settings.threads, available_cpus()
    message = f"{threads} on {cpus} CPUs"
    advice = "more threads than CPUs; lower --threads or --workers"
    return ("ok", message) if threads <= cpus else ("warn", f"{message}: {advice}")


def _kernel(settings: Settings) -> tuple[State, str]:
    kernel = compiled.load()
    if kernel is None:
        return "warn", compiled.NOT_BUILT
    if pixels.load() is None:
        return "warn", pixels.NOT_BUILT
    return "ok", f"compiled, with {next(iter(kernel.SETS))}"


def _otel(settings: Settings) -> tuple[State, str]:
    if not tracing.is_wanted():
        return "ok", "no traces: OTEL_EXPORTER_OTLP_ENDPOINT is not set"
    if not tracing.is_installed():
        advice = "pip install '.[otel]' in the source folder"
        return "warn", f"OTEL_EXPORTER_OTLP_ENDPOINT is set, but no trace can be sent: {advice}"
    return "ok", "installed"


CHECKS: Final[dict[str, Callable[[Settings], tuple[State, str]]]] = {
    "model": _model,
    "matting": _matting,
    "database": _database,
    "disk": _disk,
    "address": _address,
    "page": _page,
    "keys": _keys,
    "threads": _threads,
    "kernel": _kernel,
    "[otel]": _otel,
}
