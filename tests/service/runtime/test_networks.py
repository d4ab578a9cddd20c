"""An ONNX file in onnxruntime: closed until the next call, opened again, and not if the file has changed."""

import shutil
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from service.encoding.encoder import Encoder
from service.encoding.matting import Matting
from service.encoding.network import Network
from service.encoding.registry import Models
from service.errors import InvalidModel
from service.runtime.networks import Networks
from service.settings import SHIPPED_MATTING, Settings
from tests.support.small import model as tiny_model

IMAGES = np.random.default_rng(0).random((3, 3, tiny_model.SIZE, tiny_model.SIZE), np.float32)


def _run(network: Network) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return network.run(["theta"], {"image": IMAGES})[0]


@pytest.fixture
def file(tmp_path: Path, model_path: Path) -> Path:
    return Path(shutil.copy(model_path, tmp_path / "own.onnx"))


@pytest.mark.parametrize("kind", ["file", "bytes"])
def test_network_at_rest_answers_as_before(file: Path, kind: str) -> None:
    network = Network(file if kind == "file" else file.read_bytes(), 1)
    first = _run(network)
    network.rest()
    network.rest()
    np.testing.assert_array_equal(_run(network), first)


def test_network_at_rest_holds_no_session(file: Path) -> None:
    network = Network(file, 1)
    session = weakref.ref(network._session)
    _run(network)
    network.rest()
    assert session() is None
    assert [each.name for each in network.outputs] == ["theta"]


def test_network_at_rest_is_opened_once_by_many_threads(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    network = Network(file, 1)
    expected = _run(network)
    network.rest()
    opened: list[object] = []
    reopen = network._reopened

    def counted() -> object:
        opened.append(None)
        return reopen()

    monkeypatch.setattr(network, "_reopened", counted)
    with ThreadPoolExecutor(8) as threads:
        for answer in threads.map(lambda _: _run(network), range(32)):
            np.testing.assert_array_equal(answer, expected)
    assert len(opened) == 1


def test_network_whose_file_has_changed_at_rest_raises(file: Path) -> None:
    network = Network(file, 1)
    _run(network)
    tiny_model.build(file, trips=3)
    _run(network)  # still open
    network.rest()
    with pytest.raises(InvalidModel, match=r"own\.onnx has changed since the start"):
        _run(network)
    file.unlink()
    with pytest.raises(InvalidModel, match=r"cannot read the model .*own\.onnx: No such file"):
        _run(network)


def test_networks_of_a_started_service_rest_but_for_the_default(model_path: Path, tmp_path: Path) -> None:
    other = tiny_model.build(tmp_path / "b.onnx", meta=tiny_model.metadata(tiny_model.SPEC, "b"))
    networks = Networks.open(Settings(model=(model_path, other), matting_model=SHIPPED_MATTING, threads=1))
    networks.warm_up()
    assert isinstance(networks.models, Models)
    first, second = networks.models
    assert isinstance(networks.matting, Matting)
    held = [each._network._session is not None for each in (first, second, networks.matting)]
    assert held == [True, False, False]
    assert isinstance(second, Encoder)
    assert len(second.encode(IMAGES)) == 3
