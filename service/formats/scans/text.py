"""Formats of text: XYZ, OBJ, ASCII STL, and the header of PCD, which begins as text."""

import re
import warnings
from io import BytesIO
from itertools import pairwise
from typing import Final, Literal

import numpy as np

from service.errors import CorruptPoints, TooLarge
from service.formats.scans.limits import MAX_TRIANGLES, Doubles

LOOK: Final = 65_536  # bytes that tell the format
SEPARATORS: Final = bytes.maketrans(b",;\t", b"   ")
NUMBER: Final = rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
XYZ_LINE: Final = re.compile(rb"^[ ]*" + NUMBER + rb"(?:[ ]+" + NUMBER + rb"){2,}[ ]*\r?$")
OBJ_LINE: Final = re.compile(rb"^v[ ]+" + NUMBER, re.MULTILINE)
VERTEX: Final = re.compile(rb"^[ ]*vertex[ ]+(.*)$", re.MULTILINE)


def kind_of(data: bytes) -> Literal["pcd", "xyz", "obj", "stl"] | None:
    """Return the format of a text by its first lines; None if it is none of these."""
    zero = data.find(b"\0", 0, LOOK)  # a photo has one among its first bytes, so the search ends there
    if zero >= 0 and b"DATA binary" not in data[:zero].translate(SEPARATORS):
        return None
    head = data[:LOOK].translate(SEPARATORS)
    first = next((line.strip() for line in head.split(b"\n") if line.strip() and not line.startswith(b"#")), b"")
    if head.startswith(b"# .PCD") or first.startswith(b"VERSION"):
        return "pcd"
    if first.startswith(b"solid"):
        return "stl"
    if XYZ_LINE.match(first):
        return "xyz"
    return "obj" if OBJ_LINE.search(head) else None


def xyz(data: bytes) -> Doubles:
    """Return the first three numbers of each line, which spaces, commas or semicolons separate: (n, 3)."""
    return numbers(data.translate(SEPARATORS), (0, 1, 2), "XYZ")


def obj(data: bytes) -> Doubles:
    """Return the faces as triangles, (t, 3, 3), polygons as fans."""
    lines = data.split(b"\n")
    vertices = numbers(b"\n".join(line for line in lines if line.startswith((b"v ", b"v\t"))), (1, 2, 3), "OBJ")
    corners: list[tuple[int, int, int]] = []
    for line in lines:
        if not line.startswith((b"f ", b"f\t")):
            continue
        try:
            face = [int(corner.split(b"/", 1)[0]) for corner in line.split()[1:]]
        except ValueError as error:
            raise CorruptPoints(f"the OBJ file has a faulty face: {line[:60]!r}", field="points") from error
        corners += [(face[0], second, third) for second, third in pairwise(face[1:])]
        if len(corners) > MAX_TRIANGLES:
            raise TooLarge(f"the mesh has more than {MAX_TRIANGLES} triangles, the limit", field="points")
    if any(not 1 <= abs(each) <= len(vertices) for corner in corners for each in corner):
        detail = f"the OBJ file has a face with a vertex that is none of its {len(vertices)}"
        raise CorruptPoints(detail, field="points")
    index = np.array(corners, np.int64).reshape(-1, 3)
    triangles: Doubles = vertices[np.where(index > 0, index - 1, index)]  # negative ones count from the end
    return triangles


def stl(data: bytes) -> Doubles:
    """Return the triangles of an ASCII STL, (t, 3, 3)."""
    vertices = numbers(b"\n".join(VERTEX.findall(data.translate(SEPARATORS))), (0, 1, 2), "STL")
    if len(vertices) % 3:
        raise CorruptPoints(f"the STL file has {len(vertices)} vertices, no multiple of 3", field="points")
    return vertices.reshape(-1, 3, 3)


def numbers(data: bytes, columns: tuple[int, ...], name: str, rows: int | None = None) -> Doubles:
    """Return columns of the numbers in lines, (n, columns) float64; `rows` limits the lines and must be reached."""
    if rows == 0 or not data.strip():
        return np.empty((0, len(columns)))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about input without data
            values = np.loadtxt(
                BytesIO(data), usecols=columns, comments="#", ndmin=2, max_rows=rows, encoding="latin-1"
            )
    except (ValueError, IndexError) as error:
        raise CorruptPoints(
            f"the {name} file has a line without its numbers: {str(error)[:100]}", field="points"
        ) from error
    if rows is not None and len(values) < rows:
        raise CorruptPoints(f"the {name} file ends before its {rows} points do", field="points")
    return np.asarray(values, np.float64)
