"""The cost of a cloud: what a request is charged for, and the limits it has to keep."""

from typing import Final

from service.errors import InvalidParameter
from service.formats.points.registry import PointFormat
from service.mapping.cloud import FIRST_PART, PART
from service.mapping.spec import HOF_1, Functions, MappingSpec

UNIT: Final = 2 * HOF_1.size  # numbers that a point of the default model is multiplied with: its cost is 1
CHEAP: Final = 16  # costs up to which a cloud may have as many points as the service allows at all


def cost_of(spec: MappingSpec, *functions: Functions) -> int:
    """What a point of an object takes, the colours of all its functions included, in points of the default model; at
    least 1."""
    colors = sum(each.color.weights.size for each in functions if each.color)
    return max(1, (spec.k * spec.size + colors) // UNIT)


def check_cost(n: int, cost: int, max_points: int, field: str) -> None:
    """Refuse more points of a large function than it may take time for, with InvalidParameter."""
    most = max_points * CHEAP // cost
    if n > most:
        detail = f"{field} asks for {n} points, the limit for a function as large as this object's is {most}"
        raise InvalidParameter(detail, field=field)


def check_size(fmt: PointFormat, n: int, max_points: int) -> None:
    """Refuse more points than the format or the service allows, with InvalidParameter."""
    if n > max_points:
        raise InvalidParameter(f"n is {n}, the limit of this service is {max_points}", field="n")
    fmt.check_count(n)


def in_flight(n: int, ahead: int) -> int:
    """How many points of n a stream has at a time, computed or being computed; a small one counts for a first part."""
    return min(max(n, FIRST_PART), (ahead + 1) * PART)
