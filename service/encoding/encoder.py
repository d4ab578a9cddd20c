"""The encoder g_phi: an ONNX file that describes itself; it computes theta, and color and estimates if it can.

Its input is an image, or points of a part of an object (`service.encoding.clouds`).
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from service.encoding import estimates
from service.encoding.clouds import LEAST_POINTS
from service.encoding.estimates import Estimates
from service.encoding.framing import Framed, Framing
from service.encoding.network import Network, TensorInfo
from service.errors import InvalidModel, InvalidSpec
from service.mapping.spec import Array, Color, Functions, MappingSpec, check_color_spec, mean_of

Input = Literal["image", "points"]

FORMAT: Final = 1  # of the metadata; files written before this field existed lack it
MAX_SIDE: Final = 4096  # pixels, of an encoder's input; far above any real encoder
MAX_COUNT: Final = 65_536  # points, of an encoder's input
FAVOR: Final = 8.0  # of the surer look at a photo: 0.1 more confidence counts 2.2 times as much


@dataclass(frozen=True)
class Encoded(Functions):
    """The functions of one image's object, and estimates.

    estimates : None if the encoder makes none.
    """

    estimates: Estimates | None = None


class Encoder:
    """One onnxruntime session, and the metadata of its file.

    Attributes
    ----------
    spec : spec of the thetas.
    color_spec : spec of the color's weights; None if the model has no color.
    makes_estimates : whether it estimates the fit of the shape and the camera.
    count : number of points of its input; None for an encoder of images.
    framing : framing of the input images; an encoder of points does not use it.
    name, card : the model's name, and the whole model card.
    digest : sha256 of the file, hexadecimal.
    """

    def __init__(self, source: Path | bytes, threads: int) -> None:
        self._network = Network(source, threads)
        metadata = self._network.metadata
        _check_format(metadata)
        self.spec: Final = _spec(metadata, "hof.spec")
        self.color_spec: Final = _color_spec(metadata, self.spec)
        self.makes_estimates: Final = _makes_estimates(metadata)
        self.count: Final = _count(metadata)
        self.framing: Final = Framing() if self.count else _framing(metadata)
        self.card: Final = _card(metadata)
        self.name: Final[str] = self.card["name"]
        self.digest: Final = self._network.digest
        self._check_graph()

    @classmethod
    def open(cls, path: Path, threads: int) -> "Encoder":
        """Load a model file to run on `threads` threads.

        Raises
        ------
        InvalidModel : the file is missing, corrupt, newer than this code or not an image encoder, has no metadata,
            or has metadata that disagree with its graph.
        """
        try:
            return cls(path, threads)
        except OSError as error:
            raise InvalidModel(
                f"cannot read the model {path}: {error.strerror}; name an encoder with --model or HOF_MODEL, "
                "or make one with `hof-model export`"
            ) from error
        except InvalidModel as error:
            raise InvalidModel(f"the model {path} is unusable: {error.detail}") from error

    def encode(self, images: Array) -> list[Encoded]:
        """Compute each image's functions (paper, section 3.2): (b, 3, size, size) in [0, 1] -> b objects.

        An encoder of points takes clouds (b, count, 3) as `service.encoding.clouds.normalize` gives them.

        Raises
        ------
        InvalidModel : an output is not finite.
        """
        names = list(self.outputs)
        outputs = dict(zip(names, self._network.run(names, {self.takes: images}), strict=True))
        for name, output in outputs.items():
            if not np.isfinite(output).all():
                raise InvalidModel(f"the model {self.name} gave a {name} that is not finite")
        color_spec, count = self.color_spec, len(images)
        colors = [Color(color_spec, weights) for weights in outputs["color"]] if color_spec else [None] * count
        of_images: list[Estimates | None] = [None] * count
        if self.makes_estimates:
            rows = zip(outputs[estimates.SHAPE_CONFIDENCE], outputs[estimates.CAMERA], strict=True)
            of_images = [Estimates.of(*row) for row in rows]
        return [Encoded(*each) for each in zip(outputs["theta"], colors, of_images, strict=True)]

    def encode_photo(self, photo: Framed) -> Encoded:
        """Compute the functions of a photo's object. Raises as `encode` does."""
        return merged(photo.weights, self.encode(photo.looks))

    def blank(self) -> Array:
        """Return a white image, (1, 3, size, size), or points at one place: the input for warm-up and health checks."""
        return np.ones((1, *self.input_shape), np.float32)

    def warm_up(self) -> None:
        """Run one inference, so that the first request does not wait for memory to be allocated."""
        self.encode(self.blank())

    def rest(self) -> None:
        """Free the memory of the network until the next call, which takes about a tenth of a second longer."""
        self._network.rest()

    @property
    def takes(self) -> Input:
        """Kind of its input, which is the name of the graph's input, too."""
        return "points" if self.count else "image"

    @property
    def input_shape(self) -> tuple[int, ...]:
        """Shape of one input."""
        return (self.count, 3) if self.count else (3, self.framing.size, self.framing.size)

    @property
    def outputs(self) -> dict[str, list[int]]:
        """Names of the graph's outputs, with their shapes for one image."""
        color = {} if self.color_spec is None else {"color": [self.color_spec.size]}
        return {"theta": [self.spec.size], **color, **(estimates.OUTPUTS if self.makes_estimates else {})}

    def _check_graph(self) -> None:
        """Raise InvalidModel if the metadata disagree with the graph."""
        _check_tensors("input", self._network.inputs, {self.takes: list(self.input_shape)})
        _check_tensors("output", self._network.outputs, self.outputs)


def merged(weights: Sequence[float], looks: Sequence[Encoded]) -> Encoded:
    """Return the functions of an object in one look at a photo or several: means in which surer looks count more.

    The camera is that of the first look. Without estimates, all looks are equally sure.

    Parameters
    ----------
    weights : of each look, if all were equally sure.
    """
    first = looks[0]
    if len(looks) == 1:
        return first
    confidences = [each.estimates.shape_confidence if each.estimates else 0.0 for each in looks]
    shares = weights * np.exp(FAVOR * np.array(confidences))
    mean, confidence = mean_of(looks, shares), float(np.average(confidences, weights=shares))
    return Encoded(mean.theta, mean.color, first.estimates and replace(first.estimates, shape_confidence=confidence))


def _check_format(metadata: dict[str, str]) -> None:
    """Raise InvalidModel for files of newer versions."""
    version = metadata.get("hof.format", str(FORMAT))
    if version != str(FORMAT):
        raise InvalidModel(
            f"it has format {version[:20]}, this version of hof reads {FORMAT}: install a newer hof, or export it again"
        )


def _metadata(metadata: dict[str, str], key: str) -> object:
    """Decode the JSON value of a key. Raises InvalidModel."""
    if key not in metadata:
        raise InvalidModel(f"its metadata lacks {key!r}; export it with `hof-model export`")
    try:
        return json.loads(metadata[key])
    except (ValueError, RecursionError) as error:
        raise InvalidModel(f"its metadata {key!r} is not JSON") from error


def _spec(metadata: dict[str, str], key: str) -> MappingSpec:
    try:
        return MappingSpec.from_dict(_metadata(metadata, key))
    except InvalidSpec as error:
        raise InvalidModel(f"its metadata {key!r} is not a valid mapping spec: {error.detail}") from error


def _color_spec(metadata: dict[str, str], spec: MappingSpec) -> MappingSpec | None:
    """Return the spec of the color; None if the model has no color."""
    if "hof.color_spec" not in metadata:
        return None
    color_spec = _spec(metadata, "hof.color_spec")
    try:
        check_color_spec(spec, color_spec)
    except InvalidSpec as error:
        raise InvalidModel(f"its metadata 'hof.color_spec' does not fit 'hof.spec': {error.detail}") from error
    return color_spec


def _makes_estimates(metadata: dict[str, str]) -> bool:
    """Return whether the model makes estimates. Raises InvalidModel if a newer version defines what they mean."""
    version = metadata.get("hof.estimates", estimates.VERSION)
    if version != estimates.VERSION:
        raise InvalidModel(
            f"its estimates have version {version[:20]}, this version of hof reads {estimates.VERSION}: install a "
            "newer hof, or export it again"
        )
    return "hof.estimates" in metadata


def _count(metadata: dict[str, str]) -> int | None:
    """Return the number of points of the input; None for an encoder of images."""
    if "hof.points" not in metadata:
        return None
    match _metadata(metadata, "hof.points"):
        case {"count": int(count)} if LEAST_POINTS <= count <= MAX_COUNT:
            return count
    raise InvalidModel(f"its metadata 'hof.points' needs a count from {LEAST_POINTS} to {MAX_COUNT}")


def _framing(metadata: dict[str, str]) -> Framing:
    match _metadata(metadata, "hof.framing"):
        case {"size": int(size), "foreground_ratio": int() | float() as ratio} if (
            1 <= size <= MAX_SIDE and 0 < ratio <= 1
        ):
            return Framing(size, float(ratio))
    raise InvalidModel("its metadata 'hof.framing' needs a size of 1 or more pixels and a foreground_ratio in (0, 1]")


def _card(metadata: dict[str, str]) -> dict[str, Any]:
    card = _metadata(metadata, "hof.card")
    if isinstance(card, dict) and isinstance(card.get("name"), str) and card["name"]:
        return card
    raise InvalidModel("its metadata 'hof.card' needs a name")


def _check_tensors(kind: str, tensors: list[TensorInfo], expected: dict[str, list[int]]) -> None:
    """Raise InvalidModel unless the tensors are those expected, float32 (batch, *shape) with the batch size open."""
    by_name = {tensor.name: tensor for tensor in tensors}
    if by_name.keys() != expected.keys():
        raise InvalidModel(f"its metadata names the {kind} {', '.join(expected)}, its graph has {', '.join(by_name)}")
    for name, shape in expected.items():
        tensor = by_name[name]
        if tensor.type != "tensor(float)":
            raise InvalidModel(f"its {kind} {name!r} must be float32, not {tensor.type}")
        if tensor.shape[1:] != shape or isinstance(tensor.shape[0], int):
            raise InvalidModel(f"its {kind} {name!r} has shape {tensor.shape}, its metadata says {['batch', *shape]}")
