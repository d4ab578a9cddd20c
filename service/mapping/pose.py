"""The pose of an object before a camera: the map from the object frame to the frame of a camera.

The camera's frame has OpenCV's axes: x to the right, y down, z forward; the camera is at the origin.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from service.mapping.frame import Triple
from service.mapping.spec import Array

OBJECT_AXES: Final = "+Y is up, the front faces +Z"
CAMERA_AXES: Final = "camera at the origin: +X is right, +Y is down, +Z is forward"


@dataclass(frozen=True)
class Pose:
    """Rotation and position of an object in the frame of a camera.

    rotation : rows of the matrix from the object frame to the camera's.
    position : of the object's center, in its longest sides.
    """

    rotation: tuple[Triple, Triple, Triple]
    position: Triple

    def place(self, points: Array, scale: float = 1.0) -> Array:
        """Return points of the object frame, (n, 3) float32 times `scale`, in the camera's frame and the same unit.

        Each number is computed alone, not by a matrix product: the result does not depend on n.
        """
        placed = np.empty_like(points)
        for axis, (row, at) in enumerate(zip(self.rotation, self.position, strict=True)):
            first, second, third = (np.float32(factor) * points[:, index] for index, factor in enumerate(row))
            placed[:, axis] = first + second + third + np.float32(at * scale)
        return placed

    def turn(self, vectors: Array) -> Array:
        """Return directions of the object frame, (n, 3) float32, in the camera's frame."""
        return self.place(vectors, 0.0)
