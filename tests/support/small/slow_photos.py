"""Work of `hof encode-many` that a photo or a model kills, or that waits; worker processes import it by name."""

import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path, PosixPath

from service.runtime.bulk.photos import Setup, encode_photos
from service.storage.transfer.table import Item


def encode_or_die(setup: Setup, sources: Sequence[str]) -> list[Item]:
    """Encode photos; die of 2.png."""
    if any(Path(source).name == "2.png" for source in sources):
        os.kill(os.getpid(), signal.SIGKILL)
    return encode_photos(setup, sources)


def encode_or_wait(setup: Setup, sources: Sequence[str]) -> list[Item]:
    """Encode photos; wait for ten minutes at 2.png."""
    if any(Path(source).name == "2.png" for source in sources):
        time.sleep(600)
    return encode_photos(setup, sources)


def encode_behind_gate(gate: Path, setup: Setup, sources: Sequence[str]) -> list[Item]:
    """Encode photos, other than 0.png only once the folder `gate` holds `open`; a file there stands for each wait."""
    if sources and Path(sources[0]).name != "0.png":
        (gate / f"{os.getpid()}.waits").touch()
        while not (gate / "open").exists():
            time.sleep(0.05)
    return encode_photos(setup, sources)


class DeadlyModel(PosixPath):
    """Path of a model that kills the process that opens it."""

    def __fspath__(self) -> str:
        os.kill(os.getpid(), signal.SIGKILL)
        return super().__fspath__()


class DeadlyName(str):
    """A path that kills the process that receives it, before that process can tell which job it has taken."""

    __slots__ = ()

    def __reduce__(self) -> tuple[object, ...]:
        return os.kill, (_Receiver(), signal.SIGKILL)


class _Receiver:
    """The process that unpickles it."""

    def __reduce__(self) -> tuple[object, ...]:
        return os.getpid, ()
