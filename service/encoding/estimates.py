"""Estimates of an encoder beside the functions: how well the shape fits, and the camera that took the photo."""

import json
from dataclasses import dataclass
from typing import Final

from service.mapping.spec import Array

SHAPE_CONFIDENCE: Final = "shape_confidence"
CAMERA: Final = "camera"
OUTPUTS: Final = {SHAPE_CONFIDENCE: [1], CAMERA: [4]}  # of an encoder's graph: name -> shape for one image
VERSION: Final = "1"  # of their meaning, in the metadata of an encoder's file


@dataclass(frozen=True)
class Camera:
    """The camera that took a photo, in the object frame. It looks at the object's center.

    azimuth : degrees, -180 to 180, from the front (+Z) toward the object's left side (+X); 90 looks at that side.
    elevation : degrees above the horizontal plane through the center.
    distance : from the object's center, in its longest sides.
    roll : degrees that the camera is turned clockwise; the object in the photo is turned the other way.
    """

    azimuth: float
    elevation: float
    distance: float
    roll: float


@dataclass(frozen=True)
class Estimates:
    """Estimates for one image.

    shape_confidence : expected F-score at 2% of the longest side of the object against the true one, 0 to 1.
    camera : the camera that took the photo.
    """

    shape_confidence: float
    camera: Camera

    @classmethod
    def of(cls, confidence: Array, camera: Array) -> "Estimates":
        """Return the estimates in an encoder's outputs for one image, (1,) and (4,)."""
        return cls(float(confidence[0]), Camera(*map(float, camera)))

    def rounded(self) -> "Estimates":
        """Return the estimates with the digits that are kept and shown: far more than they are sure of."""
        azimuth, elevation, distance, roll = vars(self.camera).values()
        camera = Camera(round(azimuth, 1), round(elevation, 1), round(distance, 2), round(roll, 1))
        return Estimates(round(self.shape_confidence, 3), camera)

    def to_json(self) -> str:
        """Return the estimates as one line of JSON."""
        return json.dumps({**vars(self), CAMERA: vars(self.camera)}, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> "Estimates":
        """Read the text that `to_json` returns."""
        fields = json.loads(text)
        return cls(fields[SHAPE_CONFIDENCE], Camera(**fields[CAMERA]))

    def __str__(self) -> str:
        camera = self.camera
        return (
            f"shape confidence {self.shape_confidence}; camera at azimuth {camera.azimuth}, elevation "
            f"{camera.elevation}, roll {camera.roll} degrees, distance {camera.distance} longest sides"
        )
