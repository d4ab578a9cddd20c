"""Rows of numbers as text."""

from typing import Any, Final

import numpy.typing as npt

_ROWS: Final = 1_024  # rows at a time: Python's numbers take ten times the memory of an array's


def rows(line: str, numbers: npt.NDArray[Any], between: str = "") -> bytes:
    """Format each row of numbers (m, columns) with the %-template `line`; put `between` between two rows."""
    pieces = []
    for start in range(0, len(numbers), _ROWS):
        block = numbers[start : start + _ROWS]
        pieces.append((between.join([line] * len(block)) % tuple(block.ravel().tolist())).encode("ascii"))
    return between.encode("ascii").join(pieces)
