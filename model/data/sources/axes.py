"""The axes by which a mesh file's frame is named."""

from typing import Final, Literal, get_args

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
AXES: Final[tuple[Axis, ...]] = get_args(Axis)
