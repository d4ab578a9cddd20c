"""The image encoder g_phi: an ONNX file with its own description -> theta."""

import hashlib
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnxruntime as ort

from service.errors import InvalidModel, InvalidSpec
from service.images import Framing
from service.mapping import Array, MappingSpec

MAX_SIDE: Final = 4096  # of an encoder's input, pixels: far above any real one


class Encoder:
    """One onnxruntime session and what its file says about itself.

    Attributes
    ----------
    spec : what the thetas mean.
    framing : how the encoder wants its images.
    name, card : the model's name, and the whole model card, as in the file.
    digest : sha256 of the file, hexadecimal.
    """

    def __init__(self, source: Path | bytes, threads: int) -> None:
        data = source if isinstance(source, bytes) else source.read_bytes()
        self._session = open_session(source, threads)
        metadata = self._session.get_modelmeta().custom_metadata_map
        self.spec: Final = _spec(metadata)
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
        InvalidModel : the file is missing, corrupt or no image encoder, lacks its metadata, or its
            metadata disagrees with its graph.
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

    def encode(self, images: Array) -> Array:
        """theta of each image (paper, section 3.2): (b, 3, size, size) in [0, 1] -> (b, spec.size).

        Raises
        ------
        InvalidModel : the network gave a number that is not finite.
        """
        theta: Array = self._session.run(["theta"], {"image": images})[0]
        if not np.isfinite(theta).all():
            raise InvalidModel(f"the model {self.name} gave a theta that is not finite")
        return theta

    def warm_up(self) -> None:
        """One inference on a white image: allocates what the first request would wait for."""
        self.encode(np.ones((1, 3, self.framing.size, self.framing.size), np.float32))

    def _check_graph(self) -> None:
        """Refuse metadata that disagrees with the graph."""
        size = self.framing.size
        _check_tensor("input", self._session.get_inputs(), "image", [3, size, size])
        _check_tensor("output", self._session.get_outputs(), "theta", [self.spec.size])


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
        raise InvalidModel(f"it is no ONNX file that onnxruntime can load ({type(error).__name__})") from error


def _metadata(metadata: dict[str, str], key: str) -> object:
    if key not in metadata:
        raise InvalidModel(f"its metadata lacks {key!r}; export it with `hof-model export`")
    try:
        return json.loads(metadata[key])
    except (ValueError, RecursionError) as error:
        raise InvalidModel(f"its metadata {key!r} is not JSON") from error


def _spec(metadata: dict[str, str]) -> MappingSpec:
    try:
        return MappingSpec.from_dict(_metadata(metadata, "hof.spec"))
    except InvalidSpec as error:
        raise InvalidModel(f"its metadata 'hof.spec' is no mapping spec: {error.detail}") from error


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


def _check_tensor(kind: str, tensors: list[Any], name: str, shape: list[int]) -> None:
    """The one tensor of that kind must be float32 (batch, *shape), the batch size left open."""
    found = {tensor.name: tensor for tensor in tensors}
    if list(found) != [name]:
        raise InvalidModel(f"its {kind} must be {name!r} alone, not {sorted(found)}")
    tensor = found[name]
    if tensor.type != "tensor(float)":
        raise InvalidModel(f"its {kind} {name!r} must be float32, not {tensor.type}")
    if tensor.shape[1:] != shape or isinstance(tensor.shape[0], int):
        raise InvalidModel(f"its {kind} {name!r} has shape {tensor.shape}, its metadata says {['batch', *shape]}")
