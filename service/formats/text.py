"""Rows of numbers as text."""

from typing import Any, Final

import numpy.typing as npt

_ROWS: Final = 1_024  # at a time: Python's own numbers take ten times the memory of an array's


def rows(line: str, numbers: npt.NDArray[Any], between: str = "") -> bytes:
    """Numbers (m, columns) -> m times `line`, which formats one row, with `between` between two."""
    written = []
    for start in range(0, len(numbers), _ROWS):
        some = numbers[start : start + _ROWS]
        written.append((between.join([line] * len(some)) % tuple(some.ravel().tolist())).encode("ascii"))
    return between.encode("ascii").join(written)
