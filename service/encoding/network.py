"""An ONNX file in onnxruntime."""

import hashlib
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import onnxruntime as ort

from service.errors import InvalidModel
from service.mapping.spec import Array


class TensorInfo(NamedTuple):
    """A tensor of a graph: its name, type and shape; an open size has a name."""

    name: str
    type: str
    shape: list[int | str]


class Network:
    """An ONNX file in onnxruntime: a session, which may be closed until the next call.

    Attributes
    ----------
    digest : sha256 of the file, hexadecimal.
    metadata : texts in the file, by key.
    inputs, outputs : the tensors that the graph takes and gives.
    """

    def __init__(self, source: Path | bytes, threads: int, *, arena: bool = True) -> None:
        self._source, self._threads, self._arena = source, threads, arena
        self._opening = threading.Lock()
        self.digest: Final = self._digest()
        session = self._opened()
        self._session: ort.InferenceSession | None = session
        self.metadata: Final[dict[str, str]] = session.get_modelmeta().custom_metadata_map
        self.inputs: Final = tensors_of(session.get_inputs())
        self.outputs: Final = tensors_of(session.get_outputs())

    def run(self, names: list[str], inputs: dict[str, Array]) -> list[Array]:
        """Compute the named outputs, in an opened session.

        Raises
        ------
        InvalidModel : the file has changed, or gone, while the network was at rest.
        """
        with self._opening:
            if self._session is None:
                self._session = self._reopened()
            session = self._session
        outputs: list[Array] = session.run(names, inputs)
        return outputs

    def rest(self) -> None:
        """Close the session until the next call."""
        self._session = None

    def _opened(self) -> ort.InferenceSession:
        return open_session(self._source, self._threads, arena=self._arena)

    def _reopened(self) -> ort.InferenceSession:
        try:
            if self._digest() == self.digest:
                return self._opened()
        except OSError as error:
            raise InvalidModel(f"cannot read the model {self._source!s}: {error.strerror}") from error
        raise InvalidModel(f"the model {self._source!s} has changed since the start: start again")

    def _digest(self) -> str:
        data = self._source if isinstance(self._source, bytes) else self._source.read_bytes()
        return hashlib.sha256(data).hexdigest()


def tensors_of(nodes: Sequence[Any]) -> list[TensorInfo]:
    """Return what onnxruntime tells of tensors, without its own objects: each keeps its session in memory."""
    return [TensorInfo(node.name, node.type, list(node.shape)) for node in nodes]


def open_session(source: Path | bytes, threads: int, *, arena: bool = True) -> ort.InferenceSession:
    """Open an ONNX file as a session on `threads` threads, which sleep between calls. Raises InvalidModel.

    onnxruntime keeps a copy of bytes, but not of a file. Without `arena`, the memory of a call returns to the system
    after it.
    """
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads  # onnxruntime's own guess ignores CPU quotas
    options.inter_op_num_threads = 1
    options.enable_cpu_mem_arena = arena
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    # Else the weights lie in the arena, which grows in powers of two: 35 MiB more for the two shipped models.
    options.add_session_config_entry("session.use_device_allocator_for_initializers", "1")
    try:
        return ort.InferenceSession(source, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises a class of its own for each way to be corrupt
        raise InvalidModel(
            f"onnxruntime cannot load it ({type(error).__name__}): not an ONNX file, or damaged; download it again"
        ) from error
