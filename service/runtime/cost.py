"""The cost of a cloud: what a request is charged for, and the limits it has to keep."""

from typing import Final

from service.errors import InvalidParameter
from service.formats.points.registry import PointFormat
from service.mapping.cloud import FIRST_PART, PART
from service.mapping.spec import HOF_1, Functions, MappingSpec

UNIT: Final = 2 * HOF_1.size  # numbers that a point of the default model is multiplied with: its cost is 1
CHEAP: Final = 16  # costs up to which a cloud may have as many points as the service allows at all


def cost_of(spec: MappingSpec, *functions: Functions) -> int:
    """Return the cost of one point of an object, in points of the default model, at least 1.

    It includes the colors of all functions.
    """
    colors = sum(each.color.weights.size for each in functions if each.color)
    return max(1, (spec.k * spec.size + colors) // UNIT)


def check_cost(n: int, cost: int, max_points: int, field: str) -> None:
    """Raise InvalidParameter if n points of a function of this cost would take too long."""
    most = max_points * CHEAP // cost
    if n > most:
        detail = f"{field} asks for {n} points, the limit for a function as large as this object's is {most}"
        raise InvalidParameter(detail, field=field)


def check_size(fmt: PointFormat, n: int, max_points: int) -> None:
    """Raise InvalidParameter if n is above the limit of the service or of the format."""
    if n > max_points:
        raise InvalidParameter(f"n is {n}, the limit of this service is {max_points}", field="n")
    fmt.check_count(n)


def in_flight(n: int, ahead: int) -> int:
    """Return how many of n points a stream holds at a time, finished or in computation; at least a first part."""
    return min(max(n, FIRST_PART), (ahead + 1) * PART)
