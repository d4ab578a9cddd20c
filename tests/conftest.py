"""A tiny model, photos, databases, and a real server on a free port."""

import itertools
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import httpx
import numpy as np
import pytest

from service.encoding.encoder import Encoder
from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import Server, running
from tests.support.small import model as tiny_model
from tests.support.systems.postgres import Postgres, running_postgres

pytest_plugins = ["tests.support.browsing"]

# Tiers, the most demanding first: what a test's fixtures, or names that its module imports, tell of its needs.
# A test without any of them is of the tier `unit`, for which Python is enough.
TIERS: Final = {
    "browser": {"browser", "page"},
    "system": {
        *("postgres", "u2net", "behind_nginx", "running_s3"),
        *("check_valid", "gltf_report"),  # Node and the Khronos validator
        *("build", "built", "render_parts", "shoot", "sheets"),  # OpenGL
    },
    "server": {"server", "client", "colored", "hof_serve", "running", "serving"},
}


def pytest_configure() -> None:
    """Let processes that tests start receive Ctrl-C, also where the tests run in the background without it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark each test with its tier, unless it has such a mark. In the workers of `make test`, order the files."""
    for item in items:
        if isinstance(item, pytest.Function) and not any(item.get_closest_marker(tier) for tier in (*TIERS, "unit")):
            item.add_marker(_tier(item))
    if hasattr(config, "workerinput"):
        items[:] = _spread(items)


def _spread(items: list[pytest.Item]) -> list[pytest.Item]:
    """Return the tests in a new order: files that drive a browser or are slow first, short files last.

    A long file at the end would keep one worker busy while the others wait. Files that call a server alternate with
    the long ones: they mostly wait, while the long ones compute.
    """
    long: list[list[pytest.Item]] = []
    middle: list[list[pytest.Item]] = []
    short: list[list[pytest.Item]] = []
    none: list[pytest.Item] = []
    for _, group in itertools.groupby(items, key=lambda item: item.path):
        file = [*group]
        marks = {mark.name for item in file for mark in item.iter_markers()}
        (long if marks & {"browser", "slow"} else middle if marks & {"server", "system"} else short).append(file)
    mixed = [file for pair in itertools.zip_longest(long, middle, fillvalue=none) for file in pair]
    return [item for file in mixed + short for item in file]


def _tier(item: pytest.Function) -> str:
    parameters = getattr(item, "callspec", None)
    if parameters and parameters.params.get("database_url") == "postgresql":
        return "system"
    signs = {*item.fixturenames, *vars(item.module)}
    return next((tier for tier, needs in TIERS.items() if needs & signs), "unit")


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """Run a PostgreSQL server for all tests."""
    with running_postgres() as postgres:
        yield postgres


@pytest.fixture
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Return the URL of an empty database, of SQLite unless a test is parametrized by EVERY_DATABASE."""
    if getattr(request, "param", "sqlite") == "sqlite":
        return f"sqlite:///{tmp_path / 'store' / 'hof.db'}"
    postgres: Postgres = request.getfixturevalue("postgres")
    return postgres.create()


@pytest.fixture(scope="session")
def model_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the tiny model, without colors."""
    return tiny_model.build(tmp_path_factory.mktemp("model") / "tiny-k2.onnx")


@pytest.fixture(scope="session")
def slow_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the model of `model_path`, slowed: a black photo takes 0.7 seconds of this machine's processor."""
    path, trips = tmp_path_factory.mktemp("model") / "slow.onnx", 100_000
    encoder = Encoder.open(tiny_model.build(path, trips=trips), threads=1)
    black = np.zeros((1, 3, tiny_model.SIZE, tiny_model.SIZE), np.float32)
    black[:, 2] = 1  # without blue it fails
    start = time.thread_time()
    encoder.encode(black)
    return tiny_model.build(path, trips=round(trips * 0.7 / (time.thread_time() - start)))


@pytest.fixture(scope="session")
def colored_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the tiny model with a second output, which colors its objects."""
    path = tmp_path_factory.mktemp("colored") / "tiny-k2.onnx"
    return tiny_model.build(path, color_spec=tiny_model.COLOR_SPEC)


@pytest.fixture(scope="session", autouse=True)
def _no_default_matting() -> Iterator[None]:
    """Run without matting: tests that need it name the model."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOF_MATTING_MODEL", "none")
        yield


@pytest.fixture(scope="session")
def u2net() -> Path:
    """Return the file of U2-Net."""
    file = Path(sys.prefix) / "u2net" / "rembg" / "u2netp.onnx"
    assert file.is_file(), "`make test` gets u2netp.onnx"
    return file


@pytest.fixture
def settings(model_path: Path, database_url: str) -> Settings:
    """Return settings of a service with the tiny model and low limits."""
    return Settings(
        model=(model_path,),
        database_url=database_url,
        threads=2,
        max_image_bytes=200_000,
        max_image_pixels=1_000_000,
        max_weights_bytes=100_000,
    )


@pytest.fixture
def server(settings: Settings) -> Iterator[Server]:
    """Run a service with `settings`."""
    with running(settings) as server:
        yield server


@pytest.fixture
def client(server: Server) -> Iterator[httpx.Client]:
    """Open a client of `server`."""
    with httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        yield client


@pytest.fixture
def colored(settings: Settings, colored_path: Path) -> Iterator[httpx.Client]:
    """Open a client of a service whose model colors its objects; it shares the store with that of `client`."""
    in_color = settings.model_copy(update={"model": (colored_path,)})
    with running(in_color) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        yield client


@pytest.fixture
def photo() -> bytes:
    """Return the file of a photo of a disc."""
    return image_file(disc())
