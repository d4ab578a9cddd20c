"""The cost of a cloud: what a request is charged for, and the limits it has to keep.

The cost of a point is its time, relative to a point of the default model. The time is modeled by counts of layers,
weights and hidden units. The compiled kernel and NumPy have prices of their own: for NumPy, a layer is a few calls for
each tile of points. `python -m benchmarks.speed.costs` measures the time of many shapes, and fits the prices.
"""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from service.errors import InvalidParameter
from service.formats.points.registry import PointFormat
from service.mapping import compiled
from service.mapping.cloud import FIRST_PART, PART
from service.mapping.spec import HOF_1, MappingSpec
from service.storage.rows import Record

WIDE: Final = 2_048  # units of a layer; the values of more do not stay in the L2 cache, for a tile of points
HUGE: Final = 8_192  # units of a layer; the values of more stay in no cache
CHEAP: Final = 16  # costs up to which a cloud may have as many points as the service allows at all
COMPILED_NS: Final = {  # to two digits, so that no charge in COSTS.md is far from the cost
    "point": 22.0,
    "folded layer": 4.1,
    "folded unit": 0.034,
    "wide folded unit": 0.0,
    "layer": 0.2,
    "weight": 0.013,
    "unit": 0.095,
    "wide unit": 0.05,
    "huge unit": 0.018,
    "tanh": 0.1,
}
NUMPY_NS: Final = {
    "point": 77.0,
    "folded layer": 23.0,
    "folded unit": 0.15,
    "wide folded unit": 0.46,
    "layer": 4.2,
    "weight": 0.014,
    "unit": 0.27,
    "wide unit": 0.99,
    "huge unit": 0.79,
    "tanh": 0.14,
}


def prices_ns() -> dict[str, float]:
    """Return the prices of what computes the points here: the compiled kernel, or NumPy."""
    return COMPILED_NS if compiled.load() else NUMPY_NS


def counts_of(spec: MappingSpec, colors: Iterable[MappingSpec] = ()) -> Counter[str]:
    """Count the operations for one point, by their names in `prices_ns`; for `colors` see `cost_of`."""
    counts = Counter({"point": 1})
    for function, times in ((spec, spec.k), *((color, color.k) for color in colors)):
        if function.is_one_relu_layer:
            counts["folded layer"] += times * len(function.shapes)
            counts["folded unit"] += times * sum(function.hidden)
            counts["wide folded unit"] += times * sum(max(0, width - WIDE) for width in function.hidden)
            continue
        counts["layer"] += times * len(function.shapes)
        counts["weight"] += times * sum(n_out * n_in for n_out, n_in in function.shapes)
        counts["unit"] += times * sum(function.hidden)
        counts["wide unit"] += times * sum(max(0, width - WIDE) for width in function.hidden)
        counts["huge unit"] += times * sum(max(0, width - HUGE) for width in function.hidden)
        counts["tanh"] += times * sum(function.hidden) * (function.activation == "tanh")
    return counts


def cost_of(spec: MappingSpec, colors: Iterable[MappingSpec] = ()) -> int:
    """Return the cost of one point of an object, in points of the default model, at least 1.

    Parameters
    ----------
    colors : the spec of each of the object's color functions; a word has as many as it has colored objects.
    """
    return max(1, round(time_ns(spec, colors) / time_ns(HOF_1.with_k(2))))


def cost_of_object(record: Record, *, in_color: bool = True) -> int:
    """Return the cost of one point of a stored object, without reading its functions: see `cost_of`.

    Each function of a word counts as colored if one of them is.
    """
    colors = [record.color_spec] if in_color and record.color_spec else []
    return cost_of(record.spec, colors * (len(record.members) if record.kind == "composed" else 1))


def time_ns(spec: MappingSpec, colors: Iterable[MappingSpec] = ()) -> float:
    """Return the time of one point in nanoseconds, as the prices have it; for `colors` see `cost_of`."""
    prices = prices_ns()
    return sum(prices[name] * count for name, count in counts_of(spec, colors).items())


def check_cost(n: int, cost: int, max_points: int, field: str) -> None:
    """Raise InvalidParameter if n points of a function of this cost would take too long."""
    most = max_points * CHEAP // cost
    if n > most:
        detail = f"{field} asks for {n} points, the limit for a function as costly as this object's is {most}"
        raise InvalidParameter(detail, field=field)


def check_size(fmt: PointFormat, n: int, max_points: int) -> None:
    """Raise InvalidParameter if n is above the limit of the service or of the format."""
    if n > max_points:
        raise InvalidParameter(f"n is {n}, the limit of this service is {max_points}", field="n")
    fmt.check_count(n)


def in_flight(n: int, ahead: int) -> int:
    """Return how many of n points a stream holds at a time, finished or in computation; at least a first part."""
    return min(max(n, FIRST_PART), (ahead + 1) * PART)
