"""A tiny model, photos, databases, and a real server on a free port."""

import contextlib
import io
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
import tiny_model
import uvicorn
from PIL import Image, ImageDraw
from postgres import Postgres, running_postgres

from service.api.app import create_app
from service.encoding.encoder import Encoder
from service.server.http_protocol import bounded_heads
from service.settings import Settings

EVERY_DATABASE = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    with running_postgres() as postgres:
        yield postgres


@pytest.fixture
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database: SQLite's, unless a test is parametrised by EVERY_DATABASE."""
    if getattr(request, "param", "sqlite") == "sqlite":
        return f"sqlite:///{tmp_path / 'store' / 'hof.db'}"
    postgres: Postgres = request.getfixturevalue("postgres")
    return postgres.create()


ROOT = Path(__file__).parents[1]
pytest_plugins = ["browsing"]


@pytest.fixture(scope="session")
def model_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_model.build(tmp_path_factory.mktemp("model") / "tiny-k2.onnx")


@pytest.fixture(scope="session")
def slow_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As `model_path`, but it takes 0.7 seconds of this machine's processor for a black photo."""
    path, trips = tmp_path_factory.mktemp("model") / "slow.onnx", 100_000
    encoder = Encoder.open(tiny_model.build(path, trips=trips), threads=1)
    black = np.zeros((1, 3, tiny_model.SIZE, tiny_model.SIZE), np.float32)
    black[:, 2] = 1  # without blue it fails
    start = time.thread_time()
    encoder.encode(black)
    return tiny_model.build(path, trips=round(trips * 0.7 / (time.thread_time() - start)))


@pytest.fixture(scope="session")
def colored_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny model with a second output, which colours its objects."""
    path = tmp_path_factory.mktemp("colored") / "tiny-k2.onnx"
    return tiny_model.build(path, color_spec=tiny_model.COLOR_SPEC)


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
def settings(model_path: Path, database_url: str) -> Settings:
    return Settings(
        model=(model_path,),
        database_url=database_url,
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
    http = bounded_heads(settings.client_timeout_s)
    config = uvicorn.Config(create_app(settings), port=0, http=http, log_level="warning", lifespan="on", ws="none")
    server = Server(config)
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


def check_refused(answer: httpx.Response, field: str, limit: str) -> None:
    """A 422 of one parameter, which it names, with its limit."""
    assert answer.status_code == 422
    (error,) = answer.json()["errors"]
    assert error["field"] == field
    assert limit in error["message"]


@contextlib.contextmanager
def hof_serve(
    folder: Path, model: Path, *flags: str, **environment: str
) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """`hof serve` in a process of its own, which logs to folder/log: its address, and the process."""
    log = folder / "log"
    command = [
        str(Path(sys.executable).with_name("hof")),
        "serve",
        "--port",
        "0",
        "--model",
        str(model),
        "--threads",
        "1",
    ]
    command += ["--database-url", f"sqlite:///{folder / 'hof.db'}", *flags]
    with log.open("wb") as file:
        process = subprocess.Popen(
            command, stderr=file, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT), **environment}
        )
    try:
        while "startup complete" not in (text := log.read_text()) or "running on" not in text:
            assert process.poll() is None, text
            time.sleep(0.05)
        yield text.split("running on ")[1].split()[0], process
    finally:
        process.terminate()
        process.wait(60)


@pytest.fixture
def server(settings: Settings) -> Iterator[Server]:
    with running(settings) as server:
        yield server


@pytest.fixture
def client(server: Server) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        yield client


@pytest.fixture
def colored(settings: Settings, colored_path: Path) -> Iterator[httpx.Client]:
    """A client of a service whose model colours its objects; it shares the store with `client`'s."""
    in_color = settings.model_copy(update={"model": (colored_path,)})
    with running(in_color) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
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
