"""The service's settings: each field is a flag of `hof serve` and an environment variable HOF_*.

Defaults, limits and help live here and nowhere else; `service.cli` makes the flags from the fields.
"""

import ipaddress
import math
import os
import sys
from pathlib import Path
from typing import Annotated, Final, Literal

import platformdirs
from pydantic import BeforeValidator, Field, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from service.encoding.decode import DEFAULT_MAX_PIXELS

LogFormat = Literal["json", "text"]

SHIPPED_MODEL: Final = Path(__file__).resolve().parent.parent / "model" / "weights" / "hof1-k2.onnx"  # the default
SHIPPED_MATTING: Final = SHIPPED_MODEL.with_name("hof-matte.onnx")
U2NET: Final = "u2netp.onnx"
POINTS_CEILING: Final = 10_000_000  # the API's limit; `max_points` may only lower it
POINTS_PER_CPU: Final = 4_000_000  # in flight: about one second of work
DEFAULT_PORT: Final = 8080
DATABASE_TIMEOUT_S: Final = 10.0
DATABASE_CONNECTIONS: Final = 8  # of a process: 12 fit into the 100 that PostgreSQL allows by default
CGROUPS: Final = Path("/sys/fs/cgroup")
MIB: Final = 2**20
HOST_NAME: Final = r"(\*|[A-Za-z0-9._-]+)"
PREFIX: Final = r"^(/[A-Za-z0-9._~-]+)+$"
ORIGIN: Final = r"(\*|https?://[^/,;\s*]+)"  # as browsers send it: no path, no trailing slash


def available_cpus() -> int:
    """Return the number of CPUs this process may use: its affinity, limited by a cgroup's quota; at least 1."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    version_1 = [CGROUPS / "cpu" / f"cpu.cfs_{name}_us" for name in ("quota", "period")]
    for files in ([CGROUPS / "cpu.max"], version_1):
        try:
            quota, period = " ".join(file.read_text("ascii") for file in files).split()
            if int(quota) > 0:  # version 1 writes -1 for none
                return max(1, min(count, math.ceil(int(quota) / int(period))))
        except (OSError, ValueError):  # no cgroups of this version, or no quota ("max")
            continue
    return count


def shipped_models() -> tuple[Path, ...]:
    """Return SHIPPED_MODEL and the other encoders of its folder, sorted by name."""
    others = sorted({*SHIPPED_MODEL.parent.glob("*.onnx")} - {SHIPPED_MODEL, SHIPPED_MATTING})
    return (SHIPPED_MODEL, *others)


def default_database_url() -> str:
    """Return the URL of a SQLite file in the user's data folder; for a user without home, one that begins with "~"."""
    try:
        folder = platformdirs.user_data_path("hof")
    except RuntimeError:  # opening it says which setting helps; commands without a store do without
        folder = Path("~/.local/share/hof")
    return f"sqlite:///{folder / 'hof.db'}"


def default_matting_model() -> Path:
    """Return u2netp.onnx in the folder U2NET_HOME (the variable rembg uses), or where `make` installs it.

    Without either, or if U2NET_HOME is empty, SHIPPED_MATTING.
    """
    home = os.environ.get("U2NET_HOME")
    if home:
        return Path(home) / U2NET
    installed = Path(sys.prefix) / "u2net" / "rembg" / U2NET
    return installed if home is None and installed.is_file() else SHIPPED_MATTING


def default_log_format() -> LogFormat:
    """Return `text` on a terminal, else `json`."""
    return "text" if sys.stderr.isatty() else "json"


def _parts(value: object) -> object:
    """Split a variable's text at commas."""
    return [part.strip() for part in value.split(",") if part.strip()] if isinstance(value, str) else value


def _port(value: object) -> object:
    """Return the default for `tcp://...`: Kubernetes sets HOF_PORT to that beside a Service named hof."""
    return DEFAULT_PORT if isinstance(value, str) and value.startswith("tcp://") else value


def _shipped(path: Path) -> Path:
    """Return the shipped model that a bare name means, or the path itself if it is more than that, or a file."""
    shipped = SHIPPED_MODEL.parent / f"{path}.onnx"
    return shipped if path.parent == Path() and not path.exists() and shipped.is_file() else path


Paths = Annotated[tuple[Path, ...], NoDecode, BeforeValidator(_parts)]


class Settings(BaseSettings):
    """The settings of the service, from keyword arguments, then HOF_* variables, then defaults."""

    model_config = SettingsConfigDict(env_prefix="HOF_", frozen=True, extra="forbid")

    host: str = Field(default="127.0.0.1", description="address to listen on")
    port: Annotated[int, BeforeValidator(_port)] = Field(
        default=DEFAULT_PORT, ge=0, le=65_535, description="port to listen on; 0 takes a free one"
    )
    database_url: str = Field(
        default_factory=default_database_url,
        description="database: sqlite:///PATH or postgresql://...; default: a file in the user's data folder",
    )
    database_timeout_s: float = Field(
        default=DATABASE_TIMEOUT_S,
        gt=0,
        le=3600,
        description="maximum seconds that a call waits for PostgreSQL; after that, 503",
    )
    database_connections: int = Field(
        default=DATABASE_CONNECTIONS, ge=1, le=1000, description="maximum connections of one process to PostgreSQL"
    )
    store_dtype: Literal["float32", "float16"] = Field(
        default="float32",
        description="numbers of new objects in the database: `float32`, or `float16`, half the bytes; an object of "
        "which float16 would move a point by more than a thousandth of its longest side keeps float32",
    )
    model: Paths = Field(
        default_factory=shipped_models,
        min_length=1,
        description="image encoders, ONNX files of `hof-model export`; the first is the default of calls; repeat the "
        "flag, or separate the variable's values by commas; a name such as `hof1-k4` means that file in "
        "`model/weights`; default: `hof1-k2.onnx` and all others there",
    )
    matting_model: Path | None = Field(
        default_factory=default_matting_model,
        description="network that separates objects from any background: U2-Net, or an ONNX file of `hof-model matte`; "
        "default: u2netp.onnx in `U2NET_HOME`, else the one that `make` installed, else the shipped `hof-matte.onnx`; "
        "`none` runs without",
    )
    max_image_bytes: int = Field(default=20 * MIB, ge=1, description="largest image accepted, bytes")
    max_image_pixels: int = Field(
        default=DEFAULT_MAX_PIXELS,
        ge=1,
        description="largest image accepted, pixels (width x height); a JPEG may have 8 times as many; decoding takes "
        "up to 12 bytes for each pixel of this limit",
    )
    max_weights_bytes: int = Field(default=8 * MIB, ge=1, description="largest weights file accepted, bytes")
    max_points: int = Field(
        default=POINTS_CEILING, ge=1, le=POINTS_CEILING, description="maximum points of one request"
    )
    max_queued_images: int = Field(
        default=128, ge=1, description="maximum images being received, queued or encoded; above this, 429"
    )
    max_points_in_flight: int = Field(
        default_factory=lambda: POINTS_PER_CPU * available_cpus(),
        ge=1,
        description="maximum points being computed or sent; above this, 429; default: 4 million per CPU",
    )
    max_upload_bytes: int = Field(
        default=128 * MIB, ge=1, description="maximum bytes of all request bodies being received; above this, 429"
    )
    max_answer_bytes: int = Field(
        default=64 * MIB,
        ge=1,
        description="maximum bytes of answers complete in memory and not yet taken; above this, 429",
    )
    client_timeout_s: float = Field(
        default=30.0, gt=0, description="maximum seconds that a client may stop sending or receiving"
    )
    threads: int = Field(
        default_factory=available_cpus,
        ge=1,
        le=1024,
        description="threads for decoding, encoding and sampling; default: number of CPUs this process may use",
    )
    drain_s: float = Field(
        default=5,
        ge=0,
        le=3600,
        description="seconds to go on serving after SIGTERM, while `/health/ready` answers 503",
    )
    shutdown_s: int = Field(default=20, ge=1, le=3600, description="seconds that calls in progress then have to finish")
    workers: int = Field(
        default=1, ge=1, le=256, description="processes that serve, each with its own models and threads"
    )
    api_keys_file: Path | None = Field(
        default=None,
        description="file of API keys, one line each as `hof key` prints it; without it anyone may call",
    )
    metrics: Literal["open", "key"] = Field(
        default="open",
        description="who may read `/metrics`: `open` for anyone, `key` for keys with the scope `metrics`",
    )
    rate_limit: str | None = Field(
        default=None,
        description="maximum requests per key (per address without keys) and worker, for example `100/minute`",
    )
    cors_origins: str | None = Field(
        default=None,
        pattern=rf"^{ORIGIN}(,{ORIGIN})*$",
        description="origins whose pages may call the service, separated by commas, for example `https://shop.example`",
    )
    embed_origins: str | None = Field(
        default=None,
        pattern=rf"^{ORIGIN}(,{ORIGIN})*$",
        description="origins whose pages may show an object in a frame (`/embed`), separated by commas, for example "
        "`https://shop.example`; `*` for any",
    )
    allowed_hosts: str | None = Field(
        default=None,
        pattern=rf"^{HOST_NAME}(,{HOST_NAME})*$",
        description="public host names by which browsers reach a service without keys, separated by commas; `*` for "
        "any; addresses, `localhost`, names without a dot and private names (`.local`, `.internal`, `.svc`, "
        "`.home.arpa`) are always allowed",
    )
    trusted_proxies: str | None = Field(
        default=None,
        description="addresses or networks of proxies whose `X-Forwarded-For` and `X-Forwarded-Proto` are believed, "
        "separated by commas, for example `10.0.0.0/8`",
    )
    root_path: str | None = Field(
        default=None,
        pattern=PREFIX,
        description="path under which a proxy offers this service and which it removes, for example `/hof`; links and "
        "`Location` then begin with it",
    )
    log_level: Literal["critical", "error", "warning", "info", "debug"] = Field(
        default="info", description="lowest level that is logged"
    )
    log_format: LogFormat = Field(
        default_factory=default_log_format,
        description="`json` or `text`, one line per event on stderr; default: `text` on a terminal, else `json`",
    )

    @field_validator("trusted_proxies")
    @classmethod
    def _are_networks(cls, text: str | None) -> str | None:
        for part in [] if text is None else text.split(","):
            try:
                ipaddress.ip_network(part.strip())
            except ValueError as error:
                raise ValueError(f"{part.strip()!r} is no address or network; example: 10.0.0.0/8") from error
        return text

    @field_validator("model")
    @classmethod
    def _by_name(cls, paths: tuple[Path, ...]) -> tuple[Path, ...]:
        return tuple(_shipped(path) for path in paths)

    @field_validator("matting_model", mode="before")
    @classmethod
    def _without_matting(cls, value: object) -> object:
        return None if str(value).lower() in ("", "none") else value

    @field_validator("rate_limit")
    @classmethod
    def _is_a_rate(cls, text: str | None) -> str | None:
        if text is not None:
            from limits import parse  # imported here so that a service without a limit starts faster

            try:
                amount = parse(text).amount
            except ValueError as error:
                raise ValueError(f"{text!r} is not a rate; examples: 100/minute, 10/second") from error
            if amount < 1:
                raise ValueError(f"{text!r} allows no request; the minimum is 1, for example 1/minute")
        return text
