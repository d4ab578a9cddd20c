import pytest

from service.mapping.cloud import FIRST_PART, PART
from service.runtime.cost import in_flight


@pytest.mark.parametrize(("n", "expected"), [(1, FIRST_PART), (50_000, 50_000), (10_000_000, 3 * PART)])
def test_in_flight_of_a_stream_counts_the_parts_computed_ahead(n: int, expected: int) -> None:
    assert in_flight(n, ahead=2) == expected
