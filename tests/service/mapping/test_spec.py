import json
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.errors import InvalidSpec
from service.mapping.spec import (
    DOMAIN_DIMS,
    HOF_1,
    HOF_3,
    MAX_HIDDEN_LAYERS,
    MAX_K,
    MAX_WIDTH,
    Array,
    MappingSpec,
    apply,
    compose,
    initial_theta,
    layers,
    power,
    word_of,
)

TINY = MappingSpec("tiny", input_dim=3, hidden=(2,), output_dim=3)
# W1 (2, 3), b1 (2), W2 (3, 2), b2 (3): row by row, layer by layer
TINY_THETA = np.array([1, 2, 3, -1, 0, 1, 0.5, -0.5, 1, 0, 0, 1, 1, 1, 10, 20, 30], np.float32)


@pytest.mark.parametrize(
    ("spec", "size"),
    [(HOF_1, 7_171), (HOF_3, 33_923), (TINY, 17), (MappingSpec("4D", 4, (1024,), 3, domain="ball4"), 8_195)],
)
def test_size_of_a_spec_counts_all_weights(spec: MappingSpec, size: int) -> None:
    assert spec.size == size


def test_layers_of_theta_are_row_major_weights_before_bias() -> None:
    (w1, b1), (w2, b2) = layers(TINY, TINY_THETA)
    np.testing.assert_array_equal(w1, [[1, 2, 3], [-1, 0, 1]])
    np.testing.assert_array_equal(b1, [0.5, -0.5])
    np.testing.assert_array_equal(w2, [[1, 0], [0, 1], [1, 1]])
    np.testing.assert_array_equal(b2, [10, 20, 30])


def test_apply_of_a_small_network_equals_the_sum_by_hand() -> None:
    # x = (1, 0, 0): hidden = relu(1.5, -1.5) = (1.5, 0); x = (0, 0, 1): hidden = (3.5, 0.5)
    points = apply(TINY, TINY_THETA, np.array([[1, 0, 0], [0, 0, 1]], np.float32))
    np.testing.assert_array_equal(points, [[11.5, 20, 31.5], [13.5, 20.5, 34]])
    assert points.dtype == np.float32


def test_apply_with_tanh_uses_tanh() -> None:
    spec = MappingSpec("tanh", 3, (2,), 3, activation="tanh")
    points = apply(spec, TINY_THETA, np.array([[1, 0, 0]], np.float32))
    a, b = np.tanh(1.5), np.tanh(-1.5)
    np.testing.assert_allclose(points, [[10 + a, 20 + b, 30 + a + b]], rtol=1e-6)


def test_apply_last_layer_is_affine() -> None:
    theta = TINY_THETA.copy()
    theta[-3:] = -100
    assert (apply(TINY, theta, np.zeros((1, 3), np.float32)) < 0).all()


def affine_theta(scale: float, shift: float) -> Array:
    """f(x) = scale * x + shift where |x| < 1000: the ReLU sees positive values only."""
    eye = np.eye(3)
    parts = [eye.ravel(), np.full(3, 1000), scale * eye.ravel(), np.full(3, shift - 1000 * scale)]
    return np.concatenate(parts).astype(np.float32)


def test_compose_applies_the_last_function_first() -> None:
    spec = MappingSpec("affine", 3, (3,), 3)
    double, increment = affine_theta(2, 0), affine_theta(1, 1)
    x = np.array([[5, 6, 7]], np.float32)
    np.testing.assert_allclose(compose(spec, [double, increment], x), 2 * (x + 1))
    np.testing.assert_allclose(compose(spec, [increment, double], x), 2 * x + 1)
    np.testing.assert_allclose(power(spec.with_k(3), double, x), 8 * x)
    np.testing.assert_array_equal(compose(spec, [], x), x)


@pytest.mark.parametrize("length", [0, 16, 18])
def test_layers_of_a_theta_of_the_wrong_size_raises_invalid_spec(length: int) -> None:
    with pytest.raises(InvalidSpec, match="17"):
        layers(TINY, np.zeros(length, np.float32))


def test_layers_of_a_theta_of_the_wrong_shape_raises_invalid_spec() -> None:
    with pytest.raises(InvalidSpec):
        layers(TINY, TINY_THETA[None])


def test_initial_theta_is_seeded_and_bounded() -> None:
    theta = initial_theta(HOF_1, 3)
    np.testing.assert_array_equal(theta, initial_theta(HOF_1, 3))
    assert (theta != initial_theta(HOF_1, 4)).any()
    assert theta.dtype == np.float32
    (w1, b1), (w2, b2) = layers(HOF_1, theta)
    for values, bound in ((w1, 3**-0.5), (b1, 3**-0.5), (w2, 1 / 32), (b2, 1 / 32)):
        assert np.abs(values).max() <= bound
    assert np.abs(w1).max() > 0.99 * 3**-0.5


@st.composite
def specs(draw: st.DrawFn) -> MappingSpec:
    domain = draw(st.sampled_from(sorted(DOMAIN_DIMS)))
    return MappingSpec(
        name=draw(st.text(max_size=20)),
        input_dim=DOMAIN_DIMS[domain],
        hidden=tuple(draw(st.lists(st.integers(1, 300), min_size=1, max_size=5))),
        output_dim=3,
        activation=draw(st.sampled_from(["relu", "tanh"])),
        k=draw(st.integers(1, MAX_K)) if domain != "ball4" else 1,
        domain=domain,
    )


@given(specs())
@settings(deadline=None)
def test_json_of_any_spec_round_trips(spec: MappingSpec) -> None:
    assert MappingSpec.from_json(spec.to_json()) == spec
    assert MappingSpec.from_dict(json.loads(spec.to_json())) == spec


def test_to_json_of_a_spec_is_one_sorted_line() -> None:
    assert TINY.to_json() == (
        '{"activation":"relu","domain":"ball","hidden":[2],"input_dim":3,"k":1,"name":"tiny","output_dim":3}'
    )


def test_from_json_without_optional_fields_uses_defaults() -> None:
    assert MappingSpec.from_json('{"name":"HOF-1","input_dim":3,"hidden":[1024],"output_dim":3}') == HOF_1


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"activation": "gelu"}, "activation"),
        ({"domain": "torus"}, "domain"),
        ({"input_dim": 4}, "input_dim"),
        ({"domain": "ball4"}, "input_dim"),
        ({"output_dim": 4}, "output_dim"),
        ({"hidden": []}, "hidden"),
        ({"hidden": [8] * (MAX_HIDDEN_LAYERS + 1)}, "hidden"),
        ({"hidden": [0]}, "hidden"),
        ({"hidden": [MAX_WIDTH + 1]}, "hidden"),
        ({"hidden": [MAX_WIDTH, MAX_WIDTH]}, "hidden"),
        ({"hidden": [2.5]}, "hidden"),
        ({"hidden": [True]}, "hidden"),
        ({"hidden": 1024}, "hidden"),
        ({"k": 0}, "k"),
        ({"k": MAX_K + 1}, "k"),
        ({"k": 1.5}, "k"),
        ({"k": True}, "k"),
        ({"domain": "ball4", "input_dim": 4, "k": 2}, "k"),
        ({"name": 7}, "name"),
        ({"colour": True}, "colour"),
    ],
)
def test_from_dict_with_an_invalid_field_raises_invalid_spec(change: dict[str, Any], field: str) -> None:
    fields = json.loads(HOF_1.to_json()) | change
    with pytest.raises(InvalidSpec) as caught:
        MappingSpec.from_dict(fields)
    assert caught.value.field == field


@pytest.mark.parametrize("field", ["name", "input_dim", "hidden", "output_dim"])
def test_from_dict_with_a_missing_field_raises_invalid_spec(field: str) -> None:
    fields = asdict(HOF_1)
    del fields[field]
    with pytest.raises(InvalidSpec, match=field):
        MappingSpec.from_dict(fields)


@pytest.mark.parametrize("text", ["", "{", "[1]", "null", '"HOF-1"', "[" * 100_000])
def test_from_json_of_other_text_raises_invalid_spec(text: str) -> None:
    with pytest.raises(InvalidSpec):
        MappingSpec.from_json(text)


def test_word_of_theta_is_theta_k_times_or_its_rows() -> None:
    spec = TINY.with_k(2)
    a, b = initial_theta(spec, 0), initial_theta(spec, 1)
    for theta, word in ((a, (a, a)), (np.stack([a, b]), (a, b))):
        assert [function.tobytes() for function in word_of(spec, theta)] == [function.tobytes() for function in word]
