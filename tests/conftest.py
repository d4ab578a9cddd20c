"""A tiny model, photos, and a real server on a free port."""

import contextlib
import io
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import tiny_model
import uvicorn
from PIL import Image, ImageDraw

from service.app import create_app
from service.settings import Settings


@pytest.fixture(scope="session")
def model_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_model.build(tmp_path_factory.mktemp("model") / "tiny-k2.onnx")


@pytest.fixture(autouse=True)
def _no_matting_unless_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("U2NET_HOME", raising=False)


@pytest.fixture(scope="session")
def u2net_home() -> Path:
    """The folder of u2netp.onnx."""
    home = Path(sys.prefix) / "u2net" / "rembg"
    assert (home / "u2netp.onnx").is_file(), "`make test` gets u2netp.onnx"
    return home


@pytest.fixture
def settings(model_path: Path, tmp_path: Path) -> Settings:
    return Settings(
        model=(model_path,),
        database_url=f"sqlite:///{tmp_path / 'store' / 'hof.db'}",
        threads=2,
        max_image_bytes=200_000,
        max_image_pixels=1_000_000,
        max_weights_bytes=100_000,
    )


class Server(uvicorn.Server):
    """A server and the address it is bound to."""

    @property
    def port(self) -> int:
        port: int = self.servers[0].sockets[0].getsockname()[1]
        return port


@contextlib.contextmanager
def running(settings: Settings) -> Iterator[Server]:
    """The service in a thread, over a real socket, until the block ends."""
    server = Server(uvicorn.Config(create_app(settings), port=0, log_level="warning", lifespan="on", ws="none"))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started and thread.is_alive():
        time.sleep(0.005)
    assert server.started
    try:
        yield server
    finally:
        server.should_exit = True
        thread.join()


@pytest.fixture
def server(settings: Settings) -> Iterator[Server]:
    with running(settings) as server:
        yield server


@pytest.fixture
def client(server: Server) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        yield client


def image_file(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    """The image as a file's bytes."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def disc(colour: str = "red", size: tuple[int, int] = (120, 90), at: tuple[int, int] = (40, 30)) -> Image.Image:
    """A disc of 41 pixels on white, its box's corner at `at`."""
    image = Image.new("RGB", size, "white")
    ImageDraw.Draw(image).ellipse((*at, at[0] + 40, at[1] + 40), fill=colour)
    return image


@pytest.fixture
def photo() -> bytes:
    return image_file(disc())
