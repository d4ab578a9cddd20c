"""The service's settings: each field is a flag of `hof serve` and an environment variable HOF_*.

Defaults, limits and help live here and nowhere else; `service.cli` makes the flags from the fields.
"""

import math
import os
from pathlib import Path
from typing import Annotated, Final, Literal

import platformdirs
from pydantic import BeforeValidator, Field
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from service.images import DEFAULT_MAX_PIXELS

SHIPPED_MODEL: Final = Path(__file__).resolve().parent.parent / "model" / "weights" / "hof1-k2.onnx"  # the default
POINTS_CEILING: Final = 10_000_000  # the API's promise; `max_points` may only lower it
MIB: Final = 2**20


def available_cpus() -> int:
    """How many CPUs this process may use: its affinity, cut by a cgroup v2 quota; at least 1."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text("ascii").split()
        return max(1, min(count, math.ceil(int(quota) / int(period))))
    except (OSError, ValueError):  # no cgroup v2 here, or "max": no quota
        return count


def shipped_models() -> tuple[Path, ...]:
    """The ONNX files beside SHIPPED_MODEL, that one first, the others by name."""
    others = sorted(path for path in SHIPPED_MODEL.parent.glob("*.onnx") if path != SHIPPED_MODEL)
    return (SHIPPED_MODEL, *others)


def default_database_url() -> str:
    """SQLite in the platform's data folder of this user."""
    return f"sqlite:///{platformdirs.user_data_path('hof') / 'hof.db'}"


def default_matting_model() -> Path | None:
    """u2netp.onnx in the folder that rembg's variable U2NET_HOME names; None where it is not set."""
    home = os.environ.get("U2NET_HOME")
    return Path(home) / "u2netp.onnx" if home else None


def _parts(value: object) -> object:
    """A variable's text, cut at commas."""
    return [part.strip() for part in value.split(",") if part.strip()] if isinstance(value, str) else value


Paths = Annotated[tuple[Path, ...], NoDecode, BeforeValidator(_parts)]


class Settings(BaseSettings):
    """Read once at start, from keyword arguments first, then from HOF_* variables, and passed in."""

    model_config = SettingsConfigDict(env_prefix="HOF_", frozen=True, extra="forbid")

    host: str = Field(default="127.0.0.1", description="address to listen on")
    port: int = Field(default=8080, ge=0, le=65_535, description="port to listen on; 0 takes a free one")
    database_url: str = Field(
        default_factory=default_database_url,
        description="where objects are kept: sqlite:///PATH or postgresql://...; default: the user's data folder",
    )
    model: Paths = Field(
        default_factory=shipped_models,
        min_length=1,
        description="image encoders, ONNX files of hof-model export, the first for calls that name none; the flag may "
        "be repeated, the variable takes commas; default: `hof1-k2.onnx` and all others in `model/weights`",
    )
    matting_model: Path | None = Field(
        default_factory=default_matting_model,
        description="U2-Net, an ONNX file that tells objects from any background; default: u2netp.onnx in "
        "`U2NET_HOME`, else none",
    )
    max_image_bytes: int = Field(default=20 * MIB, ge=1, description="largest image accepted, bytes")
    max_image_pixels: int = Field(default=DEFAULT_MAX_PIXELS, ge=1, description="largest image accepted, pixels in all")
    max_weights_bytes: int = Field(default=8 * MIB, ge=1, description="largest weights file accepted, bytes")
    max_points: int = Field(default=POINTS_CEILING, ge=1, le=POINTS_CEILING, description="most points of one request")
    threads: int = Field(
        default_factory=available_cpus,
        ge=1,
        le=1024,
        description="threads for decoding, encoding and sampling; default: the CPUs this process may use",
    )
    log_level: Literal["critical", "error", "warning", "info", "debug"] = Field(
        default="info", description="least severity that is logged"
    )
