"""Weights in fewer bytes: what a file holds, what is read back, and what it costs."""

import json
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from safetensors import numpy as safetensors_numpy

from service.errors import CorruptWeights, InvalidParameter
from service.formats import tensors
from service.formats.precision import LEVELS, Dtype, from_int8, loss_of, to_float16, to_int8
from service.formats.tensors import Stored
from service.formats.weights import Weights, dump, load
from service.mapping.box import measure
from service.mapping.spec import HOF_1, Color, MappingSpec, initial_theta

TINY = MappingSpec("tiny", 3, (4,), 3, k=2)
COLOR = MappingSpec("color", 3, (5,), 3)
SMALL: tuple[Dtype, ...] = ("float16", "int8")

each_dtype = pytest.mark.parametrize("dtype", SMALL)


def _weights(dtype: Dtype, spec: MappingSpec = TINY, color: Color | None = None) -> Weights:
    theta = initial_theta(spec)
    return Weights(spec, theta, "m", color=color, frame=measure(spec, theta), dtype=dtype)


@given(npst.arrays(np.float32, TINY.size, elements=st.floats(-(2.0**100), 2.0**100, width=32)))
@settings(deadline=None)
def test_int8_restores_each_number_to_half_a_step(theta: np.ndarray[Any, np.dtype[np.float32]]) -> None:
    numbers, scales = to_int8(TINY, theta)
    restored = from_int8(TINY, numbers, scales)
    assert numbers.dtype == np.int8
    assert (numbers.shape, scales.shape) == (theta.shape, (4,))
    assert np.abs(numbers.astype(int)).max() <= LEVELS
    steps = np.repeat(scales, [12, 4, 12, 3])
    assert (np.abs(restored.astype(np.float64) - theta) <= 0.501 * steps + 1e-6 * np.abs(theta) + 1e-38).all()


def test_int8_of_a_word_has_scales_for_each_row() -> None:
    word = np.stack([initial_theta(TINY), 100 * initial_theta(TINY, 1)])
    numbers, scales = to_int8(TINY, word)
    assert (numbers.shape, scales.shape) == ((2, TINY.size), (2, 4))
    np.testing.assert_allclose(from_int8(TINY, numbers, scales)[1], word[1], atol=0.51 * float(scales[1].max()))


def test_float16_beyond_its_range_raises_invalid_parameter() -> None:
    with pytest.raises(InvalidParameter, match="beyond 65504") as caught:
        to_float16(np.array([1, -70_000], np.float32))
    assert caught.value.field == "dtype"


@each_dtype
def test_file_in_fewer_bytes_is_read_back_as_what_it_holds(dtype: Dtype) -> None:
    color = Color(COLOR, initial_theta(COLOR))
    weights = _weights(dtype, color=color)
    loaded = load(dump(weights, "safetensors"))
    assert (loaded.dtype, loaded.spec, loaded.frame) == (dtype, weights.spec, weights.frame)
    assert loaded.theta.dtype == np.float32
    np.testing.assert_allclose(loaded.theta, weights.theta, atol=0.01)
    assert loaded.color is not None
    np.testing.assert_allclose(loaded.color.weights, color.weights, atol=0.01)
    again = load(dump(loaded, "safetensors"))
    np.testing.assert_allclose(again.theta, loaded.theta, rtol=1e-6)


@each_dtype
def test_file_of_a_word_in_fewer_bytes_is_read_back(dtype: Dtype) -> None:
    thetas = np.stack([initial_theta(TINY), initial_theta(TINY, 1)])
    colors = Color(COLOR, initial_theta(COLOR)[None])
    word = Weights(TINY, thetas, "m", ("a", "b"), colors, measure(TINY, thetas), dtype)
    loaded = load(dump(word, "safetensors"))
    assert (loaded.word, loaded.theta.shape) == (("a", "b"), thetas.shape)
    np.testing.assert_allclose(loaded.theta, thetas, atol=0.01)


@pytest.mark.parametrize(("dtype", "share"), [("float16", 2), ("int8", 4)])
def test_file_in_fewer_bytes_is_that_much_shorter(dtype: Dtype, share: int) -> None:
    weights = _weights(dtype, HOF_1.with_k(2))
    assert len(dump(weights, "safetensors")) < 4 * HOF_1.size / share + 1000


@each_dtype
def test_loss_of_a_file_is_that_of_its_points(dtype: Dtype) -> None:
    weights = _weights(dtype, HOF_1.with_k(2))
    loaded = load(dump(weights, "safetensors"))
    assert weights.frame is not None
    assert loaded.loss == loss_of(weights.spec, weights.theta, loaded.theta, weights.frame)
    assert 0 < loaded.loss.mean < loaded.loss.largest < 0.05
    assert load(dump(replace(weights, dtype="float32"), "safetensors")).loss is None


@each_dtype
def test_file_in_fewer_bytes_is_read_by_the_safetensors_library(dtype: Dtype) -> None:
    weights = _weights(dtype, color=Color(COLOR, initial_theta(COLOR)))
    file = dump(weights, "safetensors")
    arrays = safetensors_numpy.load(file)
    assert arrays["theta"].dtype == dtype
    saved = safetensors_numpy.save(arrays, metadata=_header(file)["__metadata__"])
    np.testing.assert_array_equal(load(saved).theta, load(file).theta)


@each_dtype
@pytest.mark.parametrize("format_", ["npy", "json", "onnx"])
def test_other_formats_are_float32_only(dtype: Dtype, format_: Any) -> None:  # noqa: ANN401
    with pytest.raises(InvalidParameter, match="use format=safetensors") as caught:
        dump(_weights(dtype), format_)
    assert caught.value.field == "dtype"


@pytest.mark.parametrize("scale", [np.nan, np.inf, -1, 3e38])
def test_load_with_a_scale_that_gives_no_weights_raises_corrupt_weights(scale: float) -> None:
    arrays: dict[str, Stored] = {"theta_scales": np.full(4, scale, np.float32)}
    arrays["theta"] = np.full(TINY.size, 100, np.int8)
    metadata = {"format": "hof-theta-1", "spec": TINY.to_json(), "model": "m"}
    with pytest.raises(CorruptWeights):
        load(tensors.pack(metadata, arrays))


@pytest.mark.parametrize(
    "loss", ["1", "{}", '{"mean": "a", "largest": 1}', "[", '{"mean": 1}', '{"mean": NaN, "largest": 1}']
)
def test_load_with_a_damaged_loss_raises_corrupt_weights(loss: str) -> None:
    metadata = {"format": "hof-theta-1", "spec": TINY.to_json(), "model": "m", "loss": loss}
    with pytest.raises(CorruptWeights, match="loss"):
        load(tensors.pack(metadata, {"theta": initial_theta(TINY)}))


def test_load_of_int8_without_scales_raises_corrupt_weights() -> None:
    metadata = {"format": "hof-theta-1", "spec": TINY.to_json(), "model": "m"}
    with pytest.raises(CorruptWeights, match=r'"theta_scales" of shape .4., F32 and "theta" of shape .31., I8'):
        load(tensors.pack(metadata, {"theta": np.ones(TINY.size, np.int8)}))


def _header(file: bytes) -> dict[str, Any]:
    (size,) = struct.unpack_from("<Q", file)
    header: dict[str, Any] = json.loads(file[8 : 8 + size])
    return header
