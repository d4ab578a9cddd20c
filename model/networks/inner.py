"""Inner tensors of an exported encoder, which heads read: the code before theta, and the maps behind it."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import onnx

from service.encoding.network import open_session

Floats = npt.NDArray[np.float32]

# name -> end of the name of the weight that the tensor is multiplied with; the DenseNet has only the first two
READERS: Final = {
    "code": "head.linear.weight",
    "maps": "dense.0.weight",
    "last": "features.joined.weight",
    "fine": "features.fine.weight",
}
IMAGE: Final = "image"
THETA: Final = "theta"


def inner_tensors(model: onnx.ModelProto) -> dict[str, str]:
    """Return name -> tensor of the graph, for the names of READERS that the encoder has.

    Raises
    ------
    ValueError : the graph has no code, so `hof-model export` did not write it.
    """
    tensors = {}
    for node in model.graph.node:
        weight = node.input[1] if len(node.input) > 1 else ""
        for name, end in READERS.items():
            if weight in (end, f"encoder.{end}"):
                tensors[name] = node.input[0]
    if "code" not in tensors:
        raise ValueError("the model's graph has no code before theta: write it with `hof-model export`")
    return {name: tensors[name] for name in READERS if name in tensors}


class InnerEncoder:
    """An exported encoder that also gives its inner tensors.

    names : of the inner tensors, in the order of READERS.
    size : side of its images, pixels.
    """

    def __init__(self, file: Path, threads: int) -> None:
        model = onnx.load(file)
        tensors = inner_tensors(model)
        self.names: Final = tuple(tensors)
        self.size: Final[int] = model.graph.input[0].type.tensor_type.shape.dim[-1].dim_value
        del model.graph.output[:]
        for tensor in (THETA, *tensors.values()):
            model.graph.output.append(onnx.helper.make_empty_tensor_value_info(tensor))
        self._outputs = [THETA, *tensors.values()]
        self._session: Any = open_session(model.SerializeToString(), threads)

    def look(self, images: Floats) -> tuple[Floats, dict[str, Floats]]:
        """Return theta (b, size) of images (b, 3, s, s) in [0, 1], and their inner tensors by name."""
        theta, *inner = self._session.run(self._outputs, {IMAGE: images})
        return theta, dict(zip(self.names, inner, strict=True))
