"""Arguments that the compiled kernel refuses, and versions of it that are not used."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from service.mapping import compiled
from service.mapping.spec import Array
from tests.service.mapping.engines import built_kernel, needs_kernel
from tests.support.systems.modules import replace_module

pytestmark = needs_kernel


def good() -> dict[str, Any]:
    """Return arguments of `map`, in order."""
    return {
        "x": np.zeros((3, 4), np.float32),
        "origin": np.zeros(3, np.float32),
        "per_unit": np.ones(3, np.float32),
        "grid": 1,
        "starts": np.array([0, 2, 5], np.int64),
        "packed": np.zeros((5, 7), np.float32),
        "affine": np.zeros((2, 3, 4), np.float32),
        "y": np.zeros((3, 4), np.float32),
    }


TWO, SIX, TWELVE = (np.zeros((3, n), np.float32) for n in (2, 6, 12))


def outermost_arguments(places: tuple[int, int]) -> tuple[Any, ...]:
    """Return arguments of `outermost` for four points."""
    return np.zeros((3, 4), np.float32), np.zeros(places, np.int64), np.zeros(places, np.float32)


def cut_arguments(
    grid: int = 1, second: tuple[int, int] = (3, 5), crossing: tuple[int, int] = (2, 5)
) -> tuple[Any, ...]:
    """Return arguments of `cut` for a network of five units."""
    side = np.ones(3, np.float32)
    outputs = np.zeros((2, 3, 4), np.float32), np.zeros(crossing, np.bool_)
    return np.zeros((5, 4), np.float32), np.zeros(second, np.float32), grid, side, side, side, *outputs


def read_only() -> Array:
    array = np.zeros((3, 4), np.float32)
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": np.zeros((3, 4))}, "x has 2 dimensions of format 'd'; 2 of float32 are needed"),
        ({"x": np.zeros(12, np.float32)}, "x has 1 dimensions"),
        ({"x": np.zeros((4, 4), np.float32)}, "x has length 4 in dimension 0; 3 is needed"),
        ({"x": np.zeros((4, 3), np.float32).T}, "x is not a C-contiguous array"),
        ({"x": [1, 2, 3]}, "x is not a C-contiguous array"),
        ({"x": b"123"}, "x has 1 dimensions of format 'B'"),
        ({"x": np.zeros((3, 4), ">f4")}, "x has 2 dimensions of format '>f'"),
        ({"y": np.zeros((3, 5), np.float32)}, "y has length 5 in dimension 1; 4 is needed"),
        ({"y": read_only()}, "y is not a C-contiguous, writable array"),
        ({"origin": np.zeros(2, np.float32)}, "origin has length 2"),
        ({"grid": 2}, "starts has length 3 in dimension 0; 10 is needed"),
        ({"grid": -1}, "grid is -1; 0 to 256 is needed"),
        ({"grid": 2**30}, "grid is 1073741824"),
        ({"starts": np.array([0, 2, 6])}, "starts do not ascend from 0 to the 5 units"),
        ({"starts": np.array([0, 3, 2])}, "starts do not ascend"),
        ({"starts": np.array([-1, 2, 5])}, "starts do not ascend"),
        ({"starts": np.array([0, 2, 5], np.int32)}, "starts has 1 dimensions of format 'i'; 1 of int64 are needed"),
        ({"packed": np.zeros((5, 8), np.float32)}, "packed has length 8 in dimension 1; 7 is needed"),
        ({"affine": np.zeros((3, 3, 4), np.float32)}, "affine has length 3 in dimension 0; 2 is needed"),
        ({"instructions": 3}, "there is no instruction set 3 on this processor"),
        ({"instructions": -1}, "there is no instruction set -1 on this processor"),
    ],
)
def test_map_of_wrong_arguments_raises_value_error(change: dict[str, Any], message: str) -> None:
    kernel: Any = built_kernel()
    kernel.map(*good().values())
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        kernel.map(*(good() | change).values())


def network_arguments(
    widths: tuple[int, ...] = (3, 1, 3), size: int = 10, n: int = 2, dtype: type[np.floating[Any]] = np.float32
) -> tuple[Any, ...]:
    """Return arguments of `network` for a theta of `size` numbers and room for `n` values of two points."""
    x, y = np.zeros((3, 2), np.float32), np.zeros((3, n), np.float32)
    return x, np.zeros(size, dtype), np.array(widths, np.int64), False, y


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        ("uniform", (0, 0, np.zeros((4, 3), np.float32)), "u has 3 columns; an even number is needed"),
        ("uniform", (0, 0, np.zeros((3, 4), np.float32)), "u has length 3 in dimension 0; 4 is needed"),
        ("network", network_arguments(size=11), "theta has length 11 in dimension 0; 10 is needed"),
        ("network", network_arguments(size=2), "theta has length 2 in dimension 0; 10 is needed"),
        ("network", network_arguments(dtype=np.float64), "1 of float32"),
        ("network", network_arguments(n=1), "y has length 1 in dimension 1; 2 is needed"),
        ("network", network_arguments(widths=(4, 1, 3)), "x has length 3 in dimension 0; 4 is needed"),
        ("network", network_arguments(widths=(3, 1, 4)), "theta has length 10 in dimension 0; 12 is needed"),
        ("network", network_arguments(widths=(3, 0, 3)), "widths are not two or more of 1 to 65536"),
        ("network", network_arguments(widths=(3, 65_537, 3)), "widths are not two or more of 1 to 65536"),
        ("network", network_arguments(widths=(3, 65_536, 65_536, 3)), "make a network of more than 2147483647 numbers"),
        ("network", network_arguments(widths=(3,)), "widths are not two or more of 1 to 65536"),
        ("network", network_arguments(widths=()), "widths are not two or more of 1 to 65536"),
        ("pack", ((2, 3), (3, 7), 3, (5, 7)), "packed has 5 rows; 6 are needed"),
        ("pack", ((2, 3), (3, 7), 3, (7, 7)), "packed has 7 rows; 6 are needed"),
        ("pack", ((2, 3), (4, 7), 3, (6, 7)), "units has length 4"),
        ("pack", ((2, 3), (3, 7), 2, (6, 7)), "starts has length 2"),
        ("outermost", outermost_arguments((6, 5)), "places for 5 points of 4; 1 to all are needed"),
        ("outermost", outermost_arguments((5, 2)), "places has length 5 in dimension 0; 6 is needed"),
        ("spread", (SIX, TWO, 0.1, 3, TWELVE), "domain is 3; 0 to 2 is needed"),
        ("spread", (SIX, TWO, 0.1, 1, TWO), "trials has length 2 in dimension 1; 12 is needed"),
        ("climb", (TWELVE, TWELVE, SIX, np.zeros(5, np.float32)), "reached has length 5"),
        ("climb", (TWELVE, TWELVE, TWO, np.zeros(2, np.float32)), "12 trials of 2 searches; as many"),
        ("climb", (TWO, TWO, SIX, np.zeros(6, np.float32)), "2 trials of 6 searches; as many"),
        ("cut", cut_arguments(grid=-1), "grid is -1; 0 to 256 is needed"),
        ("cut", cut_arguments(grid=257), "grid is 257; 0 to 256 is needed"),
        ("cut", cut_arguments(grid=2), "affine has length 2 in dimension 0; 9 is needed"),
        ("cut", cut_arguments(second=(3, 6)), "second has length 6 in dimension 1; 5 is needed"),
        ("cut", cut_arguments(crossing=(2, 6)), "crossing has length 6 in dimension 1; 5 is needed"),
        ("cut", (*cut_arguments(), 3), "there is no instruction set 3 on this processor"),
    ],
)
def test_wrong_arguments_raise_value_error(function: str, arguments: tuple[Any, ...], message: str) -> None:
    if function == "pack":
        crossing, units, starts, packed = arguments
        floats = np.zeros(units, np.float32), np.zeros(packed, np.float32)
        arguments = np.ones(crossing, np.bool_), floats[0], np.zeros(starts, np.int64), floats[1]
    with pytest.raises(ValueError, match=message):
        getattr(built_kernel(), function)(*arguments)


def test_wrong_number_of_arguments_raises_type_error() -> None:
    kernel: Any = built_kernel()
    for function in (kernel.map, kernel.network, kernel.cut, kernel.pack, kernel.climb, kernel.uniform):
        with pytest.raises(TypeError):
            function()


@pytest.fixture
def fresh() -> Iterator[None]:
    """Let a test, and what comes after it, load the kernel anew."""
    compiled.load.cache_clear()
    yield
    compiled.load.cache_clear()


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("version", [None, compiled.VERSION - 1, compiled.VERSION + 1])
def test_load_of_a_kernel_of_another_version_gives_none(version: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    replace_module(monkeypatch, compiled.NAME, version)
    assert compiled.load() is None


@pytest.mark.usefixtures("fresh")
def test_load_of_a_kernel_of_this_version_gives_it(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = replace_module(monkeypatch, compiled.NAME, compiled.VERSION)
    assert compiled.load() is kernel
