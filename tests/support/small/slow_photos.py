"""Work of `hof encode-many` that one photo, 2.png, kills or delays; worker processes import it by name."""

import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

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


class DeadlyName(str):
    """A path that kills the process that receives it, before that process can tell which job it has taken."""

    __slots__ = ()

    def __reduce__(self) -> tuple[object, ...]:
        return os.kill, (_Receiver(), signal.SIGKILL)


class _Receiver:
    """The process that unpickles it."""

    def __reduce__(self) -> tuple[object, ...]:
        return os.getpid, ()
