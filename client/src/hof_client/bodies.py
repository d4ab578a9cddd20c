"""Bodies of answers, read piece by piece as they come; they know no HTTP client and neither block nor wait.

A `Reader` gathers a whole answer. `Rows` cuts a stream of bytes into points.
"""

import json
import re
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from hof_client.answers import Array
from hof_client.parsing import parse
from hof_client.problems import Truncated, UnexpectedAnswer

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
Floats = NDArray[np.floating[Any]]
Structured = np.ndarray[Any, np.dtype[Any]]

MAX_PLY_HEADER: Final = 4096  # bytes
PLY_TYPES: Final = {"float": "<f4", "uchar": "u1"}


class Reader(Protocol[T_co]):
    """An answer's body: `feed` takes its bytes in order, `result` what they mean, `close` frees what was held."""

    def feed(self, data: bytes) -> None:
        """Take the next bytes. Raises UnexpectedAnswer."""

    def result(self) -> T_co:
        """Return the value of the whole body. Raises Truncated or UnexpectedAnswer."""

    def close(self) -> None:
        """End, after `result` or an error."""


class Whole(Generic[T]):
    """A body that is read to its end and then decoded."""

    def __init__(self, decode: Callable[[bytes], T]) -> None:
        self._decode = decode
        self._body = bytearray()

    def feed(self, data: bytes) -> None:
        """Take the next bytes."""
        self._body += data

    def result(self) -> T:
        """Return the decoded body. Raises UnexpectedAnswer."""
        try:
            return self._decode(bytes(self._body))
        except ValueError as error:
            raise UnexpectedAnswer(f"the answer is not as documented: {error}") from error

    def close(self) -> None:
        """Do nothing: there is only memory."""


class ToFile:
    """A body that is written to a file beside its destination, and moved there when it is whole."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._part = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
        self._file = self._part.open("wb")

    def feed(self, data: bytes) -> None:
        """Write the next bytes."""
        self._file.write(data)

    def result(self) -> Path:
        """Move the file to its destination, which is returned."""
        self._file.close()
        return self._part.replace(self._path)

    def close(self) -> None:
        """Remove the file if it was not moved."""
        self._file.close()
        self._part.unlink(missing_ok=True)


class Rows:
    """Cuts a stream of bytes into rows of a type, and refuses more or fewer than n of them."""

    def __init__(self, dtype: np.dtype[Any], n: int) -> None:
        self._dtype = dtype
        self._n = n
        self._count = 0
        self._rest = b""

    def feed(self, data: bytes) -> Structured:
        """Return the rows that the next bytes complete. Raises UnexpectedAnswer if they are too many."""
        data = self._rest + data if self._rest else data
        size = self._dtype.itemsize
        m = len(data) // size
        self._rest = data[m * size :]
        self._count += m
        if self._count > self._n or (self._count == self._n and self._rest):
            raise UnexpectedAnswer(f"the answer has more than the {self._n} points that the call asked for")
        return np.frombuffer(data, self._dtype, m) if m else np.empty(0, self._dtype)

    def end(self) -> None:
        """Raise Truncated unless all rows came."""
        if self._count < self._n or self._rest:
            raise Truncated(f"the answer ended after {self._count} of {self._n} points")


class PointChunks:
    """Bare coordinates as points: `feed` returns arrays (m, 3), which have n rows in all."""

    def __init__(self, n: int, dtype: str) -> None:
        self._rows = Rows(np.dtype((dtype, 3)), n)

    def feed(self, data: bytes) -> Floats:
        """Return the points that the next bytes complete, m >= 0. Raises UnexpectedAnswer."""
        return self._rows.feed(data)

    def end(self) -> None:
        """Raise Truncated unless all points came."""
        self._rows.end()


class PointArray:
    """Bare coordinates as one array (n, 3), allocated once and filled as bytes come."""

    def __init__(self, n: int, dtype: str) -> None:
        self._chunks = PointChunks(n, dtype)
        self._points = np.empty((n, 3), np.dtype(dtype).newbyteorder("="))
        self._count = 0

    def feed(self, data: bytes) -> None:
        """Take the next bytes. Raises UnexpectedAnswer."""
        chunk = self._chunks.feed(data)
        self._points[self._count : self._count + len(chunk)] = chunk
        self._count += len(chunk)

    def result(self) -> Floats:
        """Return all points. Raises Truncated."""
        self._chunks.end()
        return self._points

    def close(self) -> None:
        """Do nothing: there is only memory."""


@dataclass(frozen=True, eq=False)
class ColoredPoints:
    """A cloud: points (n, 3) float32, and colors (n, 3) uint8, sRGB; None for an object without color."""

    points: Array
    colors: NDArray[np.uint8] | None


class ColoredArrays:
    """A binary PLY as points and colors, in arrays that are allocated once and filled as bytes come."""

    def __init__(self, n: int) -> None:
        self._head = b""
        self._rows: Rows | None = None
        self._n = n
        self._points = np.empty((n, 3), np.float32)
        self._colors: NDArray[np.uint8] | None = None
        self._count = 0

    def feed(self, data: bytes) -> None:
        """Take the next bytes. Raises UnexpectedAnswer."""
        if self._rows is None:
            head, end, data = (self._head + data).partition(b"end_header\n")
            self._head = head + end
            if not end:
                self._check_head(len(head) <= MAX_PLY_HEADER)
                return
            self._rows = self._rows_after(head.decode("ascii", "replace"))
        rows = self._rows.feed(data)
        place = slice(self._count, self._count + len(rows))
        self._points[place] = np.stack([rows[name] for name in ("x", "y", "z")], axis=1)
        if self._colors is not None:
            self._colors[place] = np.stack([rows[name] for name in ("red", "green", "blue")], axis=1)
        self._count += len(rows)

    def _rows_after(self, head: str) -> Rows:
        """Return the reader of the rows that the file's head describes."""
        properties = re.findall(r"^property (\w+) (\w+)$", head, re.MULTILINE)
        names = [name for _, name in properties]
        is_colored = names == ["x", "y", "z", "red", "green", "blue"]
        self._check_head(head.startswith("ply\nformat binary_little_endian 1.0\n"))
        self._check_head(f"\nelement vertex {self._n}\n" in head and (is_colored or names == ["x", "y", "z"]))
        self._check_head(all(type_ in PLY_TYPES for type_, _ in properties))
        if is_colored:
            self._colors = np.empty((self._n, 3), np.uint8)
        return Rows(np.dtype([(name, PLY_TYPES[type_]) for type_, name in properties]), self._n)

    @staticmethod
    def _check_head(is_right: bool) -> None:
        if not is_right:
            raise UnexpectedAnswer("the answer is no PLY as the service documents it")

    def result(self) -> ColoredPoints:
        """Return all points with their colors. Raises Truncated."""
        if self._rows is None:
            raise Truncated("the answer ended in the head of the PLY")
        self._rows.end()
        return ColoredPoints(self._points, self._colors)

    def close(self) -> None:
        """Do nothing: there is only memory."""


def json_reader(kind: type[T]) -> Callable[[Mapping[str, str]], Whole[T]]:
    """Return a reader of JSON that gives a dataclass of this package."""
    return lambda _: Whole(lambda body: parse(kind, json.loads(body)))
