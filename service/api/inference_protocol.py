"""Open Inference Protocol, version 2: parse its requests into images, and format thetas as its answers.

A tensor is JSON, or bytes after the JSON (the extension `binary_tensor_data`); `Inference-Header-Content-Length` then
gives the length of the JSON. https://github.com/kserve/open-inference-protocol
"""

import json
import math
from collections.abc import Sequence
from itertools import chain
from typing import Any, Final, NamedTuple

import numpy as np
from pydantic import ValidationError
from pydantic_core import from_json

from service.api.inference_messages import InferenceRequest, Input, Output
from service.api.problems import field_errors
from service.encoding.encoder import Encoded, Encoder
from service.encoding.estimates import CAMERA, SHAPE_CONFIDENCE
from service.errors import InvalidInput, InvalidParameter
from service.mapping.spec import Array
from service.runtime.batcher import MAX_BATCH

EXTENSION: Final = "binary_tensor_data"
HEADER_LENGTH: Final = "Inference-Header-Content-Length"
JSON_NUMBER_BYTES: Final = 24  # a number and its comma: a double has 17 digits, a point, an exponent
JSON_OVERHEAD_BYTES: Final = 16_384  # everything but the numbers
OUT_OF_RANGE: Final = "inputs[0]: its numbers must be finite and lie in [0, 1]"
MAX_MEMBERS: Final = 1_024  # members of all objects in the JSON, and its lists and elements beside the numbers


class Inference(NamedTuple):
    """A parsed request and its images, (b, 3, size, size) float32 in [0, 1]."""

    request: InferenceRequest
    images: Array


def tensors(encoder: Encoder) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Return the shapes of the inputs and of the outputs by name, without the batch dimension; all are FP32."""
    size = encoder.framing.size
    return {"image": [3, size, size]}, encoder.outputs


def max_body_bytes(encoder: Encoder) -> int:
    """Return the maximum size of a request: MAX_BATCH images as JSON, which takes more bytes than binary."""
    return MAX_BATCH * 3 * encoder.framing.size**2 * JSON_NUMBER_BYTES + JSON_OVERHEAD_BYTES


def parse(body: bytes, header_length: str | None, encoder: Encoder) -> Inference:
    """Parse the body of a request.

    Parameters
    ----------
    header_length : value of HEADER_LENGTH, the length of the JSON; None if the whole body is JSON.

    Raises
    ------
    InvalidInput : the body is not JSON, or shorter than `header_length`, or has more lists than images can have.
    InvalidParameter : a member is missing, unknown or wrong, or the images do not fit the encoder, or there are more
        elements than MAX_BATCH images have.
    """
    length = len(body) if header_length is None else _length(header_length, len(body))
    text = body[:length]
    _check_counts(text, encoder.framing.size)
    try:
        request = InferenceRequest.model_validate(from_json(text, allow_inf_nan=False))
    except ValidationError as error:
        first = field_errors(error.errors(include_url=False, include_context=False, include_input=False))[0]
        raise InvalidParameter(f"{first.field or 'the body'}: {first.message}", field=first.field or None) from error
    except ValueError as error:
        raise InvalidInput("the body is not JSON") from error
    for i, output in enumerate(request.outputs):
        if output.name not in encoder.outputs:
            field = f"outputs[{i}].name"
            raise InvalidParameter(f"{field}: the model's outputs are {', '.join(encoder.outputs)}", field=field)
    return Inference(request, _images(request.inputs[0], body[length:], encoder.framing.size))


def answer(encoder: Encoder, request: InferenceRequest, functions: Sequence[Encoded]) -> tuple[bytes, dict[str, str]]:
    """Return the body that answers a request with the functions of its images, and the body's headers."""
    outputs, binary = [], []
    for output in request.outputs or [Output(name=name) for name in encoder.outputs]:
        array = _stack(output.name, functions)
        tensor: dict[str, Any] = {"name": output.name, "datatype": "FP32", "shape": array.shape}
        is_binary = output.parameters.binary_data
        if request.parameters.binary_data_output if is_binary is None else is_binary:
            binary.append(array.astype("<f4").tobytes())
            tensor["parameters"] = {"binary_data_size": array.nbytes}
        else:
            tensor["data"] = array.ravel().tolist()
        outputs.append(tensor)
    content = {"model_name": encoder.name, "outputs": outputs} | ({"id": request.id} if request.id is not None else {})
    header = json.dumps(content, separators=(",", ":")).encode()
    if not binary:
        return header, {"Content-Type": "application/json"}
    return b"".join((header, *binary)), {"Content-Type": "application/octet-stream", HEADER_LENGTH: str(len(header))}


def _check_counts(text: bytes, size: int) -> None:
    """Bound what parsing the JSON can make, before it is parsed: each element takes ten times its bytes and more.

    Characters are counted, those in strings too, of which a request needs few.

    Raises
    ------
    InvalidInput : more lists than MAX_BATCH nested images have.
    InvalidParameter : more elements, or more members.
    """
    numbers, lists = MAX_BATCH * 3 * size**2, MAX_BATCH * 3 * (size + 2)
    if text.count(b",") > numbers + MAX_MEMBERS:
        detail = f"the JSON has more elements than {MAX_BATCH} images, which have {numbers} numbers"
        raise InvalidParameter(detail, field="inputs[0].data")
    if text.count(b":") > MAX_MEMBERS:
        raise InvalidParameter(f"the JSON has more than {MAX_MEMBERS} members: leave out those that are unknown")
    if text.count(b"[") > lists + MAX_MEMBERS:
        raise InvalidInput(f"the JSON has more than {lists + MAX_MEMBERS} lists, more than {MAX_BATCH} images can have")


def _length(text: str, limit: int) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) < 20 and int(text) <= limit):
        raise InvalidInput(f"{HEADER_LENGTH}: it must be at most the body's {limit} bytes", field=HEADER_LENGTH)
    return int(text)


def _images(tensor: Input, binary: bytes, size: int) -> Array:
    """Return the numbers of the input in its shape. Raises InvalidParameter."""
    batch, *rest = tensor.shape or [0]
    if not 1 <= batch <= MAX_BATCH or rest != [3, size, size]:
        limit = f"[b, 3, {size}, {size}], b from 1 to {MAX_BATCH}"
        raise InvalidParameter(f"inputs[0].shape: it must be {limit}", field="inputs[0].shape")
    binary_size = tensor.parameters.binary_data_size
    if (tensor.data is None) == (binary_size is None):
        raise InvalidParameter("inputs[0]: it needs either data or parameters.binary_data_size", field="inputs[0].data")
    if tensor.data is not None:
        images = _from_json(tensor.data, tensor.shape)
    elif binary_size == len(binary) == 4 * math.prod(tensor.shape):
        images, binary = np.frombuffer(binary, "<f4").reshape(tensor.shape), b""
    else:
        raise InvalidParameter(
            f"inputs[0]: its shape has {4 * math.prod(tensor.shape)} bytes, binary_data_size says {binary_size}, "
            f"{len(binary)} follow the JSON",
            field="inputs[0].parameters.binary_data_size",
        )
    if binary:
        raise InvalidParameter(f"{len(binary)} bytes after the JSON belong to no input", field="inputs[0].parameters")
    if not ((images >= 0) & (images <= 1)).all():  # NaN is neither
        raise InvalidParameter(OUT_OF_RANGE, field="inputs[0].data")
    return images.astype(np.float32, copy=False)


def _from_json(data: list[Any], shape: list[int]) -> Array:
    """Return a flat or nested list as an array of a shape. Raises InvalidParameter.

    Numbers and types are checked in Python: NumPy would make an array of anything, such as of the longest string's
    size for each element.
    """
    numbers = data
    for length in shape[1:] if data and isinstance(data[0], list) else ():
        if not all(type(row) is list and len(row) == length for row in numbers):
            raise _not_numbers(shape)
        numbers = list(chain.from_iterable(numbers))
    if len(numbers) != math.prod(shape) or not set(map(type, numbers)) <= {int, float}:  # `bool` is not `int` here
        raise _not_numbers(shape)
    if min(numbers) < 0 or max(numbers) > 1:  # before NumPy, for which an integer may be too large
        raise InvalidParameter(OUT_OF_RANGE, field="inputs[0].data")
    return np.array(numbers, np.float32).reshape(shape)


def _not_numbers(shape: list[int]) -> InvalidParameter:
    detail = f"inputs[0].data: it must be {math.prod(shape)} numbers, flat or nested as its shape"
    return InvalidParameter(detail, field="inputs[0].data")


def _stack(name: str, functions: Sequence[Encoded]) -> Array:
    """Return the rows of an output, (b, size of the output)."""
    estimates = [each.estimates for each in functions if each.estimates]
    if name == SHAPE_CONFIDENCE:
        return np.array([[each.shape_confidence] for each in estimates], np.float32)
    if name == CAMERA:
        return np.array([list(vars(each.camera).values()) for each in estimates], np.float32)
    if name == "theta":
        return np.stack([each.theta for each in functions])
    return np.stack([each.color.weights for each in functions if each.color])
