"""Report on the separation of an object from its background, as it is kept with the object."""

import json
from dataclasses import dataclass

from service.encoding.framing import Box, Framed
from service.encoding.masks import Mask


@dataclass(frozen=True)
class ImageReport:
    """Report on a photo.

    mask : source of the mask.
    box : left, top, right, bottom of the object, pixels of the upright image.
    confidence : confidence of the mask, 0 to 1; None without a mask.
    width, height : size of the upright image, pixels.
    """

    mask: Mask
    box: Box
    confidence: float | None
    width: int
    height: int

    @classmethod
    def of(cls, framed: Framed) -> "ImageReport":
        """Return the report on a framed image."""
        confidence = None if framed.confidence is None else round(framed.confidence, 3)
        left, top, right, bottom = map(int, framed.box)
        return cls(framed.mask, (left, top, right, bottom), confidence, framed.width, framed.height)

    def to_json(self) -> str:
        """Return the report as one line of JSON."""
        return json.dumps(vars(self), separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> "ImageReport":
        """Read the text that `to_json` returns."""
        fields = json.loads(text)
        return cls(**{**fields, "box": tuple(fields["box"])})

    def __str__(self) -> str:
        left, top, right, bottom = self.box
        shown = "the whole picture" if self.mask == "none" else f"mask by {self.mask}, confidence {self.confidence}"
        return f"{shown}; box {left},{top} to {right},{bottom} of {self.width} x {self.height} pixels"
