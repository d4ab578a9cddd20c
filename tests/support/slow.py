"""A slow network, photos that it is slow for, and waiting for what it does."""

import time
from collections.abc import Callable

from PIL import Image

from service.runtime.parts import Runtime
from tests.support.photos import image_file
from tests.support.server import Server

DEADLINE_S = 60
PATH = "/encode?background=keep"


def plain(red: int, green: int = 0, blue: int = 255) -> bytes:
    """A photo of one colour. Black slows the model of this file's tests down, white does not; no blue breaks it."""
    return image_file(Image.new("RGB", (32, 32), (red, green, blue)))


def until(condition: Callable[[], bool]) -> None:
    """Wait for what other threads bring about."""
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def runtime_of(server: Server) -> Runtime:
    runtime: Runtime = server.config.app.state.runtime  # type: ignore[union-attr]
    return runtime
