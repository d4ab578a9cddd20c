import hashlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from service.encoding.encoder import Encoder
from service.errors import InvalidModel
from tests.support.small import model as tiny_model

OPEN_TIMEOUT_S = 60


def test_encoder_of_a_file_has_its_metadata(model_path: Path) -> None:
    encoder = Encoder.open(model_path, threads=1)
    assert encoder.spec == tiny_model.SPEC
    assert (encoder.framing.size, encoder.framing.foreground_ratio) == (tiny_model.SIZE, 0.85)
    assert encoder.name == "tiny-k2"
    assert encoder.card == tiny_model.CARD
    assert encoder.digest == hashlib.sha256(model_path.read_bytes()).hexdigest()


@pytest.mark.parametrize("batch", [1, 3])
def test_encode_of_a_batch_computes_the_network(model_path: Path, batch: int) -> None:
    images = np.random.default_rng(0).random((batch, 3, tiny_model.SIZE, tiny_model.SIZE), np.float32)
    objects = Encoder.open(model_path, threads=1).encode(images)
    assert [functions.color for functions in objects] == [None] * batch
    theta = np.stack([functions.theta for functions in objects])
    assert theta.shape == (batch, tiny_model.SPEC.size)
    assert theta.dtype == np.float32
    np.testing.assert_allclose(theta, tiny_model.theta_of(images), atol=1e-5)


def test_encode_with_color_gives_the_same_theta_and_a_color_per_image(model_path: Path, colored_path: Path) -> None:
    images = np.random.default_rng(0).random((3, 3, tiny_model.SIZE, tiny_model.SIZE), np.float32)
    plain, encoder = Encoder.open(model_path, threads=1), Encoder.open(colored_path, threads=1)
    matrix, b = tiny_model.color_parameters()
    assert (plain.color_spec, encoder.color_spec) == (None, tiny_model.COLOR_SPEC)
    for image, one, other in zip(images, plain.encode(images), encoder.encode(images), strict=True):
        np.testing.assert_array_equal(other.theta, one.theta)
        assert other.color
        assert other.color.spec == tiny_model.COLOR_SPEC
        np.testing.assert_allclose(other.color.weights, image.mean(axis=(1, 2)) @ matrix + b, atol=1e-5)


def test_open_of_a_missing_file_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(InvalidModel, match=r"nothere\.onnx.*HOF_MODEL"):
        Encoder.open(tmp_path / "nothere.onnx", 1)


@pytest.mark.parametrize("keep", [0, 100, 0.5, -1])
def test_open_of_a_corrupt_file_raises_invalid_model(model_path: Path, tmp_path: Path, keep: float) -> None:
    data = model_path.read_bytes()
    cut = int(len(data) * keep) if isinstance(keep, float) else keep
    bad = tmp_path / "bad.onnx"
    bad.write_bytes(data[:cut])
    with pytest.raises(InvalidModel, match=r"bad\.onnx is unusable"):
        Encoder.open(bad, 1)


def _with(key: str, value: object) -> dict[str, str]:
    """Return the metadata with one entry replaced, or removed if the value is None."""
    meta = {**tiny_model.metadata(), key: value if isinstance(value, str) else json.dumps(value)}
    return {name: text for name, text in meta.items() if text != "null"}


SPEC = json.loads(tiny_model.SPEC.to_json())
COLOR_SPEC = json.loads(tiny_model.COLOR_SPEC.to_json())


@pytest.mark.parametrize(
    ("meta", "message"),
    [
        (_with("hof.format", 2), "it has format 2, this version of hof reads 1: install a newer hof"),
        (_with("hof.spec", None), "lacks 'hof.spec'"),
        (_with("hof.framing", None), "lacks 'hof.framing'"),
        (_with("hof.card", None), "lacks 'hof.card'"),
        (_with("hof.spec", "{"), "'hof.spec' is not JSON"),
        (_with("hof.spec", {**SPEC, "k": 0}), "k is 0, it must lie"),
        (_with("hof.spec", {**SPEC, "hidden": [17]}), "output 'theta' has shape"),
        (_with("hof.framing", {"size": 64, "foreground_ratio": 0.85}), "input 'image' has shape"),
        (_with("hof.framing", {"size": "32", "foreground_ratio": 0.85}), "needs a size"),
        (_with("hof.framing", {"size": 32, "foreground_ratio": 0}), "needs a size"),
        (_with("hof.card", {"name": ""}), "needs a name"),
        (_with("hof.card", []), "needs a name"),
        (
            _with("hof.color_spec", {**COLOR_SPEC, "k": 0}),
            "'hof.color_spec' is not a valid mapping spec: k is 0, it must lie",
        ),
        (_with("hof.color_spec", {**COLOR_SPEC, "k": 2}), "'hof.color_spec' does not fit .* k is 2, it must be 1"),
        (
            _with("hof.color_spec", {**COLOR_SPEC, "domain": "cube"}),
            "domain is 'cube', it must be that of the points, 'ball'",
        ),
        (_with("hof.color_spec", COLOR_SPEC), "names the output theta, color, its graph has theta"),
    ],
)
def test_open_with_wrong_metadata_raises_invalid_model(tmp_path: Path, meta: dict[str, str], message: str) -> None:
    with pytest.raises(InvalidModel, match=message):
        Encoder.open(tiny_model.build(tmp_path / "m.onnx", meta=meta), 1)


def test_open_of_a_file_without_format_reads_it(tmp_path: Path) -> None:
    assert Encoder.open(tiny_model.build(tmp_path / "m.onnx", meta=_with("hof.format", None)), 1).name == "tiny-k2"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"batch": 1}, "has shape"),
        ({"output": "weights"}, "names the output theta, its graph has weights"),
        ({"color_spec": tiny_model.COLOR_SPEC, "meta": tiny_model.metadata()}, "theta, its graph has theta, color"),
        (
            {"color_spec": tiny_model.COLOR_SPEC, "meta": _with("hof.color_spec", {**COLOR_SPEC, "hidden": [9]})},
            "output 'color' has shape",
        ),
    ],
)
def test_open_of_a_graph_of_another_shape_raises_invalid_model(
    tmp_path: Path, wrong: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidModel, match=message):
        Encoder.open(tiny_model.build(tmp_path / "m.onnx", **wrong), 1)


def test_encode_of_a_theta_that_is_not_finite_raises_invalid_model(tmp_path: Path) -> None:
    encoder = Encoder.open(tiny_model.build(tmp_path / "m.onnx", bias=float("inf")), 1)
    with pytest.raises(InvalidModel, match="not finite"):
        encoder.warm_up()


def test_onnxruntime_sends_no_telemetry(model_path: Path, tmp_path: Path) -> None:
    """Telemetry would store an id and its events in the user's cache folder."""
    home = tmp_path / "home"
    home.mkdir()
    encoder = "service.encoding.encoder"
    program = f"from pathlib import Path; from {encoder} import Encoder; Encoder.open(Path({str(model_path)!r}), 1)"
    root = str(Path(__file__).parents[3])
    subprocess.run(
        [sys.executable, "-c", program],
        env={"HOME": str(home), "PYTHONPATH": root, "PYTHONDONTWRITEBYTECODE": "1"},
        check=True,
        timeout=OPEN_TIMEOUT_S,
    )
    assert list(home.iterdir()) == []
