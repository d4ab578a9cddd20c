"""Photos that slow the tiny network down, and waiting for other threads."""

import time
from collections.abc import Callable

from PIL import Image

from service.runtime.parts import Runtime
from tests.support.photos import image_file
from tests.support.server import Server

DEADLINE_S = 60
PATH = "/encode?background=keep"


def plain(red: int, green: int = 0, blue: int = 255) -> bytes:
    """Return a photo of one color. For `slow_model` black is slow, white is not, and a photo without blue fails."""
    return image_file(Image.new("RGB", (32, 32), (red, green, blue)))


def until(condition: Callable[[], bool]) -> None:
    """Wait until a condition holds that other threads bring about."""
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def runtime_of(server: Server) -> Runtime:
    """Return the opened parts of a running service."""
    runtime: Runtime = server.config.app.state.runtime  # type: ignore[union-attr]
    return runtime
