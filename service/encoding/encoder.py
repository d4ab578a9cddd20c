"""The image encoder g_phi: an ONNX file with its own description -> theta, and colour where it has one."""

import hashlib
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnxruntime as ort

from service.encoding.framing import Framing
from service.errors import InvalidModel, InvalidSpec
from service.mapping.spec import Array, Color, Functions, MappingSpec, check_color_spec

FORMAT: Final = 1  # of the metadata; files of before it was written have none
MAX_SIDE: Final = 4096  # of an encoder's input, pixels: far above any real one


class Encoder:
    """One onnxruntime session and what its file says about itself.

    Attributes
    ----------
    spec : what the thetas mean.
    color_spec : what the colours' weights mean; None where the model has no colour.
    framing : how the encoder wants its images.
    name, card : the model's name, and the whole model card, as in the file.
    digest : sha256 of the file, hexadecimal.
    """

    def __init__(self, source: Path | bytes, threads: int) -> None:
        data = source if isinstance(source, bytes) else source.read_bytes()
        self._session = open_session(source, threads)
        metadata = self._session.get_modelmeta().custom_metadata_map
        _check_format(metadata)
        self.spec: Final = _spec(metadata, "hof.spec")
        self.color_spec: Final = _color_spec(metadata, self.spec)
        self.framing: Final = _framing(metadata)
        self.card: Final = _card(metadata)
        self.name: Final[str] = self.card["name"]
        self.digest: Final = hashlib.sha256(data).hexdigest()
        self._check_graph()

    @classmethod
    def open(cls, path: Path, threads: int) -> "Encoder":
        """Load a model file to run on so many threads.

        Raises
        ------
        InvalidModel : the file is missing, corrupt, newer than this code or no image encoder, lacks its metadata,
            or its metadata disagrees with its graph.
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

    def encode(self, images: Array) -> list[Functions]:
        """What each image shows (paper, section 3.2): (b, 3, size, size) in [0, 1] -> b objects' functions.

        Raises
        ------
        InvalidModel : the network gave a number that is not finite.
        """
        names = list(self.outputs)
        outputs = dict(zip(names, self._session.run(names, {"image": images}), strict=True))
        for name, output in outputs.items():
            if not np.isfinite(output).all():
                raise InvalidModel(f"the model {self.name} gave a {name} that is not finite")
        if self.color_spec is None:
            return [Functions(theta) for theta in outputs["theta"]]
        colors = [Color(self.color_spec, weights) for weights in outputs["color"]]
        return [Functions(theta, color) for theta, color in zip(outputs["theta"], colors, strict=True)]

    def blank(self) -> Array:
        """A white image as input, (1, 3, size, size): what asks for an inference and nothing else."""
        return np.ones((1, 3, self.framing.size, self.framing.size), np.float32)

    def warm_up(self) -> None:
        """One inference: allocates what the first request would wait for."""
        self.encode(self.blank())

    @property
    def outputs(self) -> dict[str, list[int]]:
        """Names of the graph's outputs, and their shapes for one image."""
        theta = {"theta": [self.spec.size]}
        return theta if self.color_spec is None else theta | {"color": [self.color_spec.size]}

    def _check_graph(self) -> None:
        """Refuse metadata that disagrees with the graph."""
        size = self.framing.size
        _check_tensors("input", self._session.get_inputs(), {"image": [3, size, size]})
        _check_tensors("output", self._session.get_outputs(), self.outputs)


def open_session(source: Path | bytes, threads: int, *, arena: bool = True) -> ort.InferenceSession:
    """An ONNX file as a session on so many threads that sleep between calls.

    Of bytes onnxruntime keeps a copy, of a path none. Without `arena` the memory of a call goes back to the
    system after it. Raises InvalidModel.
    """
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads  # onnxruntime's own guess ignores CPU quotas
    options.inter_op_num_threads = 1
    options.enable_cpu_mem_arena = arena
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return ort.InferenceSession(source, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises a class of its own for each way to be corrupt
        raise InvalidModel(
            f"it is no ONNX file that onnxruntime can load ({type(error).__name__}); get it anew"
        ) from error


def _check_format(metadata: dict[str, str]) -> None:
    """Refuse the files of newer versions."""
    told = metadata.get("hof.format", str(FORMAT))
    if told != str(FORMAT):
        raise InvalidModel(
            f"it is of format {told[:20]}, this version of hof reads {FORMAT}: install a newer hof, or export it anew"
        )


def _metadata(metadata: dict[str, str], key: str) -> object:
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
        raise InvalidModel(f"its metadata {key!r} is no mapping spec: {error.detail}") from error


def _color_spec(metadata: dict[str, str], spec: MappingSpec) -> MappingSpec | None:
    """The spec of the colours, where the file has any."""
    if "hof.color_spec" not in metadata:
        return None
    color_spec = _spec(metadata, "hof.color_spec")
    try:
        check_color_spec(spec, color_spec)
    except InvalidSpec as error:
        raise InvalidModel(f"its metadata 'hof.color_spec' does not fit 'hof.spec': {error.detail}") from error
    return color_spec


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


def _check_tensors(kind: str, tensors: list[Any], expected: dict[str, list[int]]) -> None:
    """The tensors of that kind must be float32 (batch, *shape), by name, and no others; the batch size left open."""
    found = {tensor.name: tensor for tensor in tensors}
    if found.keys() != expected.keys():
        raise InvalidModel(f"by its metadata its {kind} is {' and '.join(expected)}, by its graph {', '.join(found)}")
    for name, shape in expected.items():
        tensor = found[name]
        if tensor.type != "tensor(float)":
            raise InvalidModel(f"its {kind} {name!r} must be float32, not {tensor.type}")
        if tensor.shape[1:] != shape or isinstance(tensor.shape[0], int):
            raise InvalidModel(f"its {kind} {name!r} has shape {tensor.shape}, its metadata says {['batch', *shape]}")
