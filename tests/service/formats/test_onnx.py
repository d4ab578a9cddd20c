"""ONNX files of mapping functions: valid, and run by onnxruntime to the same points."""

import numpy as np
import onnx
import onnxruntime as ort
import pytest
from onnx import numpy_helper

from service import mapping
from service.formats.onnx import dump
from service.mapping.canonical import canonical_points
from service.mapping.spec import HOF_1, HOF_3, Array, MappingSpec, initial_theta

SPECS = [
    HOF_1.with_k(2),
    HOF_3,
    MappingSpec("tanh", 3, (8, 5), 3, activation="tanh", k=3, domain="cube"),
    MappingSpec("one", 3, (1,), 3, domain="sphere"),
    MappingSpec("four", 4, (300,), 3, domain="ball4"),
]


def _run(data: bytes, x: Array) -> Array:
    points: Array = ort.InferenceSession(data).run(["points"], {"x": x})[0]
    return points


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
@pytest.mark.parametrize("n", [1, 1000])
def test_onnx_in_onnxruntime_gives_the_points_of_the_reference(spec: MappingSpec, n: int) -> None:
    theta, x = initial_theta(spec, 3), canonical_points(spec.domain, n, 0)
    points = _run(dump(spec, theta, {}), x)
    assert points.shape == (n, 3)
    assert points.dtype == np.float32
    np.testing.assert_allclose(points, mapping.power(spec, theta, x), atol=1e-5)


def test_onnx_of_a_word_applies_the_last_function_first() -> None:
    spec = SPECS[2]
    word, x = [initial_theta(spec, seed) for seed in range(3)], canonical_points(spec.domain, 100, 0)
    points = _run(dump(spec, np.stack(word), {}), x)
    np.testing.assert_allclose(points, mapping.compose(spec, word, x), atol=1e-5)


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_onnx_with_a_frame_gives_framed_points(spec: MappingSpec) -> None:
    theta, x = initial_theta(spec, 3), canonical_points(spec.domain, 1000, 0)
    frame = mapping.measure(spec, theta)
    data = dump(spec, theta, {}, frame)
    onnx.checker.check_model(onnx.load_model_from_string(data), full_check=True)
    expected = (mapping.power(spec, theta, x) - frame.center) / frame.unit
    np.testing.assert_allclose(_run(data, x), expected, atol=1e-5 / min(1, frame.unit))


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_onnx_file_is_valid_and_has_metadata(spec: MappingSpec) -> None:
    data = dump(spec, initial_theta(spec), {"hof.model": "é 模型", "hof.spec": spec.to_json()})
    model = onnx.load_model_from_string(data)
    onnx.checker.check_model(model, full_check=True)
    assert model.SerializeToString() == data, "onnx writes its fields in another way"
    assert {entry.key: entry.value for entry in model.metadata_props} == {
        "hof.model": "é 模型",
        "hof.spec": spec.to_json(),
    }
    (x,), (points,) = model.graph.input, model.graph.output
    assert [dim.dim_param or dim.dim_value for dim in x.type.tensor_type.shape.dim] == ["n", spec.input_dim]
    assert [dim.dim_param or dim.dim_value for dim in points.type.tensor_type.shape.dim] == ["n", 3]


def test_onnx_of_a_word_stores_equal_functions_once() -> None:
    spec = HOF_1.with_k(4)
    a, b = initial_theta(spec, 0), initial_theta(spec, 1)
    data = dump(spec, np.stack([a, b, a, a]), {})
    model = onnx.load_model_from_string(data)
    sizes = [numpy_helper.to_array(tensor).size for tensor in model.graph.initializer]
    assert sum(sizes) == 2 * spec.size
    assert len(dump(spec, a, {})) < 4 * spec.size + 2000
