"""Tensors in a safetensors file, read and written.

Such a file is a uint64 header length, a JSON header and the bytes of the tensors
(https://huggingface.co/docs/safetensors). The safetensors library sets no limit on what it parses and reads metadata
from named files only, so both directions are written here.
"""

import itertools
import json
import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from service.errors import CorruptWeights

Stored = npt.NDArray[Any]
Tensors = dict[str, tuple[str, list[int]]]  # type and shape by name

MAX_HEADER_BYTES: Final = 16_384
NUMPY_TYPES: Final[Mapping[str, np.dtype[Any]]] = {"F32": np.dtype("<f4"), "F16": np.dtype("<f2"), "I8": np.dtype("i1")}


def split(data: bytes) -> tuple[dict[str, Any], memoryview]:
    """Return the decoded header and the bytes of the tensors. Raises CorruptWeights."""
    if len(data) < 8:
        raise CorruptWeights("the file has fewer than 8 bytes: it is not a safetensors file")
    (size,) = struct.unpack_from("<Q", data)
    if size > MAX_HEADER_BYTES:
        raise CorruptWeights(f"the header has {size} bytes, it may have at most {MAX_HEADER_BYTES}")
    if len(data) < 8 + size:
        raise CorruptWeights("the file ends within its header")
    try:
        header = json.loads(data[8 : 8 + size])
    except (ValueError, RecursionError) as error:
        raise CorruptWeights("the header is not JSON") from error
    if not isinstance(header, dict):
        raise CorruptWeights("the header is not a JSON object")
    return header, memoryview(data)[8 + size :]


def read(header: dict[str, Any], payload: memoryview, allowed: Sequence[Tensors]) -> dict[str, Stored]:
    """Read the tensors, in any order in the file. Raises CorruptWeights."""
    for tensors in allowed:
        for order in itertools.permutations(tensors):
            entries = _entries({name: tensors[name] for name in order})
            if header == entries and len(payload) == _end(entries):
                return {name: _array(name, payload, entry) for name, entry in entries.items()}
    expected = " and ".join(f'"{name}" of shape {shape}, {type_}' for name, (type_, shape) in allowed[0].items())
    raise CorruptWeights(f"the file must hold {expected}, and nothing else")


def _entries(tensors: Tensors) -> dict[str, dict[str, Any]]:
    """Return the header's entries for tensors that are stored one after another."""
    entries: dict[str, dict[str, Any]] = {}
    for name, (type_, shape) in tensors.items():
        begin = _end(entries)
        end = begin + NUMPY_TYPES[type_].itemsize * math.prod(shape)
        entries[name] = {"dtype": type_, "shape": shape, "data_offsets": [begin, end]}
    return entries


def _end(entries: dict[str, dict[str, Any]]) -> int:
    return max((entry["data_offsets"][1] for entry in entries.values()), default=0)


def _array(name: str, payload: memoryview, entry: dict[str, Any]) -> Stored:
    begin, end = entry["data_offsets"]
    array = np.frombuffer(payload[begin:end], NUMPY_TYPES[entry["dtype"]]).reshape(entry["shape"])
    if not np.isfinite(array).all():
        raise CorruptWeights(f"{name} has numbers that are not finite")
    return array


def pack(metadata: Mapping[str, str], arrays: Mapping[str, Stored]) -> bytes:
    """Write a file of arrays of `NUMPY_TYPES`, in their order. Equal arguments give equal bytes."""
    types = {kind: name for name, kind in NUMPY_TYPES.items()}
    little = {name: array.astype(array.dtype.newbyteorder("<"), copy=False) for name, array in arrays.items()}
    tensors = {name: (types[array.dtype], list(array.shape)) for name, array in little.items()}
    text = json.dumps({"__metadata__": metadata} | _entries(tensors), separators=(",", ":")).encode("ascii")
    text = text.ljust(-len(text) % 8 + len(text))  # tensors start at a multiple of 8 bytes
    return struct.pack("<Q", len(text)) + text + b"".join(array.tobytes() for array in little.values())
