"""Answers of the service as frozen dataclasses. Their fields are the members of the schemas in openapi.json."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class Spec:
    """The shape of a function: the mapping function, whose weights are theta, or the color function of its points.

    Attributes
    ----------
    hidden : widths of the hidden layers, first to last.
    activation : `relu` or `tanh`.
    k : number of times f is applied; the object is f^k of the canonical points.
    domain : canonical domain: `ball`, `sphere` or `ball4` of radius 1, or `cube`, [-1, 1]^3.
    """

    name: str
    input_dim: int
    hidden: tuple[int, ...]
    output_dim: int
    activation: str
    k: int
    domain: str


@dataclass(frozen=True, kw_only=True)
class Box:
    """The bounding box of an object in its function's own numbers, as `frame="raw"` gives them.

    The object frame is (raw - (low + high) / 2) / max(high - low).
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class ImageReport:
    """Report on the separation of the object from its background.

    Attributes
    ----------
    mask : method that removed the background: `alpha`, `border`, `matting` or `none`.
    box : left, top, right, bottom of the object, in pixels of the upright image.
    width, height : of the upright image, in pixels.
    confidence : 1 if every pixel is either object or background; None if the mask is `none`.
    """

    mask: str
    box: tuple[int, int, int, int]
    width: int
    height: int
    confidence: float | None = None


@dataclass(frozen=True, kw_only=True)
class Camera:
    """The camera that took the photo, as the model sees it. It looks at the object's center, in the object frame.

    Attributes
    ----------
    azimuth : degrees from the front (+Z) toward +X: 0 sees the front, 90 the side at +X, 180 the back.
    elevation : degrees above the object's horizontal plane.
    distance : from the object's center, in its longest sides.
    roll : degrees that the camera is turned clockwise; the object in the photo is turned the other way.
    """

    azimuth: float
    elevation: float
    distance: float
    roll: float


@dataclass(frozen=True, kw_only=True)
class Links:
    """Paths of an object and of its files, from the service's root; `photo` is None unless one is kept."""

    self: str
    points: str
    mesh: str
    weights: str
    photo: str | None = None


@dataclass(frozen=True, kw_only=True)
class StoredObject:
    """An object: a mapping function that the service keeps.

    Attributes
    ----------
    kind : `encoded`, `imported`, `composed` or `interpolated`.
    label : the name that people gave it; None without one.
    model : the model that theta comes from.
    color : spec of the color function; None for an object without color.
    word : of a composed object, the ids of its k functions, the last one applied first.
    parents : of an interpolated object, the ids of the objects whose thetas it averages.
    bytes : size of theta, 4 for each number; of a composed object, of its k thetas.
    dimensions : width, height and depth in the object frame: the longest is 1. None in lists for objects of an older
        version of the service, until they are read.
    frame : bounding box in the function's own numbers; None as `dimensions`.
    image : of an encoded object, the report on its photo.
    shape_confidence : expected F-score at 2% of the longest side against the true object, 0 to 1; None unless the
        object was encoded by a model that estimates it. `image.confidence` is that of the mask.
    camera : the camera that took the photo; None as `shape_confidence`.
    """

    id: str
    kind: str
    label: str | None = None
    created_at: datetime
    model: str
    spec: Spec
    color: Spec | None = None
    word: tuple[str, ...] | None = None
    parents: tuple[str, ...] | None = None
    bytes: int
    dimensions: tuple[float, float, float] | None = None
    frame: Box | None = None
    image: ImageReport | None = None
    shape_confidence: float | None = None
    camera: Camera | None = None
    links: Links


@dataclass(frozen=True, kw_only=True)
class EncodedObject(StoredObject):
    """A stored object, the report on its photo, and its weights if the call asked for them.

    Attributes
    ----------
    images : of several photos, the report on each; `image` is that on the first. None for one photo.
    weights : (spec.size,) float32, theta; None unless included.
    color_weights : float32, the weights of the color function; None unless included, or without color.
    """

    image: ImageReport
    images: tuple[ImageReport, ...] | None = None
    weights: Array | None = field(default=None, compare=False)
    color_weights: Array | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class EncodedWeights:
    """An object that the service did not keep: its weights. Fields as in `EncodedObject`."""

    model: str
    spec: Spec
    color: Spec | None = None
    bytes: int
    dimensions: tuple[float, float, float]
    frame: Box
    image: ImageReport
    images: tuple[ImageReport, ...] | None = None
    shape_confidence: float | None = None
    camera: Camera | None = None
    weights: Array = field(compare=False)
    color_weights: Array | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class Placement:
    """The place of a completed object in the frame of the points that were sent.

    A point of the object frame, turned about +Y by `turn` degrees, is p there, and lies at `scale` p + `center`.

    Attributes
    ----------
    turn : degrees about +Y, from +Z to +X; 0 if the front looks along +Z.
    count : number of points; of a mesh, that were sampled from its surface.
    """

    center: tuple[float, float, float]
    scale: float
    turn: float
    count: int


@dataclass(frozen=True, kw_only=True)
class CompletedObject(StoredObject):
    """A stored object that was completed from points, and its weights if the call asked for them.

    Attributes
    ----------
    weights : (spec.size,) float32, theta; None unless included.
    """

    placement: Placement
    weights: Array | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class CompletedWeights:
    """An object that was completed from points and not kept: its weights. Fields as in `CompletedObject`."""

    model: str
    spec: Spec
    bytes: int
    dimensions: tuple[float, float, float]
    frame: Box
    placement: Placement
    weights: Array = field(compare=False)


@dataclass(frozen=True, kw_only=True)
class ObjectPage:
    """A page of the list of objects, newest first; `next` is the cursor of the next page, None on the last."""

    items: tuple[StoredObject, ...]
    next: str | None = None
    limit: int


@dataclass(frozen=True, kw_only=True)
class ComposedObjects:
    """The objects of `compose_all`, in lexicographic order of their words."""

    objects: tuple[StoredObject, ...]


@dataclass(frozen=True, kw_only=True)
class PlannedPath:
    """A path around an object, or why there is none.

    Attributes
    ----------
    path : waypoints from start to goal, to be joined by straight lines; None if there is no path.
    length : of the path, in the unit of `scale`.
    straight : the path is the straight line from start to goal.
    reason : `start inside`, `goal inside` or `enclosed`; None if there is a path.
    """

    path: tuple[tuple[float, float, float], ...] | None
    length: float | None
    straight: bool
    reason: str | None


@dataclass(frozen=True, kw_only=True)
class Health:
    """The answer to a probe: `live` or `ready`."""

    status: str


@dataclass(frozen=True, kw_only=True)
class ModelFraming:
    """Framing of a model's images: side in pixels, and the share of it that the object's longer side fills."""

    size: int
    foreground_ratio: float


@dataclass(frozen=True, kw_only=True)
class Model:
    """A loaded model; `digest` is the sha256 of its file, `card` the model card as the file carries it."""

    name: str
    digest: str
    spec: Spec
    color: Spec | None = None
    framing: ModelFraming | None = None
    points: int | None = None
    card: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class ModelList:
    """The loaded models; the first is the default of calls that name no model."""

    models: tuple[Model, ...]


@dataclass(frozen=True, kw_only=True)
class FieldError:
    """An error in one parameter."""

    field: str
    message: str
