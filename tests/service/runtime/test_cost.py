from dataclasses import replace
from datetime import UTC, datetime

import pytest
from threadpoolctl import threadpool_limits

from service.mapping import compiled
from service.mapping.cloud import FIRST_PART, PART
from service.mapping.spec import HOF_1, HOF_3, MappingSpec
from service.runtime.cost import cost_of, cost_of_object, in_flight
from service.storage.rows import Record
from tests.service.mapping.engines import needs_kernel
from tests.support.point_times import measure

SLACK = 3.0  # between charge and measurement on any machine; benchmarks/COSTS.md has 1.5 on the one that was measured


@pytest.mark.parametrize(("n", "expected"), [(1, FIRST_PART), (50_000, 50_000), (10_000_000, 3 * PART)])
def test_in_flight_of_a_stream_counts_the_parts_computed_ahead(n: int, expected: int) -> None:
    assert in_flight(n, ahead=2) == expected


def test_cost_of_the_default_model_and_of_smaller_functions_is_1() -> None:
    assert [cost_of(spec) for spec in (HOF_1.with_k(2), HOF_1, MappingSpec("x", 3, (8,), 3))] == [1, 1, 1]


@pytest.mark.parametrize(
    "spec",
    [
        HOF_3.with_k(2),
        MappingSpec("deep", 3, (64,) * 64, 3),
        MappingSpec("deep and narrow", 3, (1,) * 64, 3, k=16),
        MappingSpec("deep tanh", 3, (64,) * 64, 3, activation="tanh"),
        MappingSpec("tanh", 3, (1024,), 3, activation="tanh", k=2),
        MappingSpec("four inputs", 4, (1024,), 3, domain="ball4"),
        MappingSpec("wide", 3, (1024, 1024), 3),
    ],
    ids=lambda spec: spec.name,
)
@pytest.mark.parametrize("engine", ["numpy", pytest.param("kernel", marks=needs_kernel)])
def test_cost_of_a_shape_follows_its_time_beside_the_default_model(
    spec: MappingSpec, engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if engine == "numpy":
        monkeypatch.setattr(compiled, "load", lambda: None)
    with threadpool_limits(1, user_api="blas"):
        default, ns = measure((HOF_1.with_k(2), spec), rounds=3)
    assert 1 / SLACK < cost_of(spec) / (ns / default) < SLACK


def test_cost_of_an_object_includes_each_color_function() -> None:
    color = MappingSpec("color", 3, (128, 128), 3)
    encoded = Record("a", "encoded", "m", HOF_1.with_k(2), datetime.now(UTC), color_spec=color)
    composed = replace(encoded, kind="composed", members=("a", "b"))
    assert cost_of_object(encoded, in_color=False) == 1
    assert cost_of_object(composed) == cost_of(encoded.spec, [color, color]) > cost_of_object(encoded) > 1
