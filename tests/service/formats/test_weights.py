import io
import json
import struct
from dataclasses import asdict

import numpy as np
import numpy.typing as npt
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from safetensors import numpy as safetensors_numpy

from service.errors import CorruptWeights, InvalidParameter, InvalidSpec
from service.formats.tensors import MAX_HEADER_BYTES
from service.formats.weights import MAX_JSON_NUMBERS, WEIGHT_FORMATS, Weights, dump, load
from service.mapping.frame import Frame
from service.mapping.spec import HOF_1, Array, MappingSpec, initial_theta

TINY = MappingSpec("tiny", 3, (2,), 3, k=2)
THETA = np.linspace(-1, 1, TINY.size, dtype=np.float32)
WEIGHTS = Weights(TINY, THETA, "hof1-k2")
FILE = dump(WEIGHTS, "safetensors")
WORD = Weights(TINY, np.stack([THETA, -THETA]), "hof1-k2", ("a", "b"))
METADATA = {"format": "hof-theta-1", "spec": TINY.to_json(), "model": "hof1-k2"}
TENSOR = {"dtype": "F32", "shape": [17], "data_offsets": [0, 68]}

printable = st.text(st.characters(categories=["L", "N", "P", "S"]), min_size=1, max_size=200)
finite = st.floats(width=32, allow_nan=False, allow_infinity=False)


def assemble(header: object, payload: bytes = THETA.tobytes()) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + payload


def assert_equal(a: Weights, b: Weights) -> None:
    assert (a.spec, a.model, a.word) == (b.spec, b.model, b.word)
    assert a.theta.shape == b.theta.shape
    assert a.theta.tobytes() == b.theta.tobytes()
    assert a.theta.dtype == b.theta.dtype == np.float32


@given(
    name=printable,
    model=printable,
    hidden=st.lists(st.integers(1, 9), min_size=1, max_size=3),
    k=st.integers(1, 16),
    data=st.data(),
)
@settings(deadline=None)
def test_load_of_a_dumped_file_round_trips(
    name: str, model: str, hidden: list[int], k: int, data: st.DataObject
) -> None:
    spec = MappingSpec(name, 3, tuple(hidden), 3, k=k)
    theta = data.draw(npst.arrays(np.float32, spec.size, elements=finite))
    weights = Weights(spec, theta, model)
    assert_equal(load(dump(weights, "safetensors")), weights)
    as_json = json.loads(dump(weights, "json"))
    np.testing.assert_array_equal(np.array(as_json["theta"], np.float32), theta)
    np.testing.assert_array_equal(np.load(io.BytesIO(dump(weights, "npy"))), theta)


def test_dump_as_safetensors_is_read_by_the_library() -> None:
    weights = Weights(HOF_1, initial_theta(HOF_1), "hof1")
    tensors = safetensors_numpy.load(dump(weights, "safetensors"))
    assert list(tensors) == ["theta"]
    np.testing.assert_array_equal(tensors["theta"], weights.theta)


def test_load_of_a_file_by_the_safetensors_library_reads_it() -> None:
    assert_equal(load(safetensors_numpy.save({"theta": THETA}, metadata=METADATA)), WEIGHTS)


def test_dump_as_safetensors_gives_these_bytes() -> None:
    (size,) = struct.unpack_from("<Q", FILE)
    assert size % 8 == 0
    assert json.loads(FILE[8 : 8 + size]) == {"__metadata__": METADATA, "theta": TENSOR}
    assert FILE[8 + size :] == struct.pack("<17f", *THETA)


def test_dump_as_json_has_these_fields() -> None:
    fields = json.loads(dump(WEIGHTS, "json"))
    assert fields.keys() == {"format", "model", "spec", "theta"}
    assert (fields["format"], fields["model"]) == ("hof-theta-1", "hof1-k2")
    assert MappingSpec.from_dict(fields["spec"]) == TINY


def test_dump_as_json_of_too_many_numbers_raises_invalid_parameter() -> None:
    spec = MappingSpec("wide", 3, (200,), 3, k=2)
    wide = Weights(spec, np.zeros((spec.k, spec.size), np.float32), "m")
    assert len(json.loads(dump(wide, "json"))["theta"]) == 2
    large = Weights(spec, np.broadcast_to(np.float32(0), (MAX_JSON_NUMBERS // spec.size + 1, spec.size)), "m")
    with pytest.raises(InvalidParameter, match="at most 1000000"):
        dump(large, "json")


def test_dump_of_a_composed_object_has_k_thetas_and_its_word() -> None:
    file = dump(WORD, "safetensors")
    assert_equal(load(file), WORD)
    np.testing.assert_array_equal(safetensors_numpy.load(file)["theta"], WORD.theta)
    (size,) = struct.unpack_from("<Q", file)
    metadata = METADATA | {"format": "hof-word-1", "word": '["a", "b"]'}
    assert json.loads(file[8 : 8 + size])["__metadata__"] == metadata
    as_json = json.loads(dump(WORD, "json"))
    assert (as_json["word"], as_json["spec"], as_json["format"]) == (
        ["a", "b"],
        asdict(TINY) | {"hidden": [2]},
        "hof-word-1",
    )
    np.testing.assert_array_equal(as_json["theta"], WORD.theta)
    np.testing.assert_array_equal(np.load(io.BytesIO(dump(WORD, "npy"))), WORD.theta)


def test_load_of_a_dumped_frame_round_trips() -> None:
    frame = Frame.of(np.array([-0.1, -1 / 3, 0], np.float32), np.array([1e-7, 2, 0], np.float32))
    framed = Weights(TINY, THETA, "m", frame=frame)
    assert load(dump(framed, "safetensors")).frame == frame
    assert load(FILE).frame is None
    assert json.loads(dump(framed, "json"))["frame"] == {"low": list(frame.low), "high": list(frame.high)}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"low":[0,0],"high":[1,1]}',
        '{"low":[0,0,2],"high":[1,1,1]}',
        '{"low":[0,0,NaN],"high":[1,1,1]}',
        '{"low":[0,0,0],"high":[1,1,1e99]}',
        '{"low":[0,0,{}],"high":[1,1,1]}',
    ],
)
def test_load_of_a_wrong_frame_raises_corrupt_weights(text: str) -> None:
    with pytest.raises(CorruptWeights, match="frame"):
        load(safetensors_numpy.save({"theta": THETA}, metadata={**METADATA, "frame": text}))


def test_dump_as_onnx_has_metadata() -> None:
    model = onnx.load_model_from_string(dump(WORD, "onnx"))
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    assert metadata == {"hof.model": "hof1-k2", "hof.spec": TINY.to_json(), "hof.word": '["a", "b"]'}


def test_dump_of_either_byte_order_is_little_endian() -> None:
    swapped = Weights(TINY, THETA.astype(">f4"), "x")
    for name in WEIGHT_FORMATS:
        assert dump(swapped, name) == dump(Weights(TINY, THETA, "x"), name)


def test_load_gives_theta_memory_of_its_own() -> None:
    theta = load(FILE).theta
    assert theta.flags.owndata
    assert theta.flags.writeable


def test_weight_formats_have_these_names() -> None:
    assert list(WEIGHT_FORMATS) == ["safetensors", "npy", "json", "onnx"]
    assert all(fmt.extension == f".{name}" for name, fmt in WEIGHT_FORMATS.items())


# What is refused


@pytest.mark.parametrize("length", range(len(FILE)))
def test_load_of_any_truncation_raises_corrupt_weights(length: int) -> None:
    with pytest.raises(CorruptWeights):
        load(FILE[:length])


def test_load_with_trailing_bytes_raises_corrupt_weights() -> None:
    with pytest.raises(CorruptWeights):
        load(FILE + b"\0")


@given(st.binary(max_size=300))
@settings(deadline=None)
def test_load_of_noise_raises_corrupt_weights(data: bytes) -> None:
    with pytest.raises(CorruptWeights):
        load(data)


@given(position=st.integers(8, len(FILE) - 1), value=st.integers(0, 255))
@settings(deadline=None)
def test_load_with_a_changed_byte_reads_or_refuses(position: int, value: int) -> None:
    data = bytearray(FILE)
    data[position] = value
    try:
        weights = load(bytes(data))
    except (CorruptWeights, InvalidSpec):
        return
    assert weights.theta.shape == (weights.spec.size,)
    assert np.isfinite(weights.theta).all()


@pytest.mark.parametrize("size", [MAX_HEADER_BYTES + 1, 2**40, 2**64 - 1])
def test_load_with_a_huge_header_refuses_it_unread(size: int) -> None:
    with pytest.raises(CorruptWeights, match=r"at most 16384"):
        load(struct.pack("<Q", size) + b" " * 100_000)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_load_of_numbers_that_are_not_finite_raises_corrupt_weights(value: float) -> None:
    theta = THETA.copy()
    theta[5] = value
    with pytest.raises(CorruptWeights, match="finite"):
        load(dump(Weights(TINY, theta, "x"), "safetensors"))


@pytest.mark.parametrize("size", [0, 16, 18, 7171])
def test_load_of_a_theta_of_the_wrong_size_raises_corrupt_weights(size: int) -> None:
    with pytest.raises(CorruptWeights, match=r"\[17\]"):
        load(safetensors_numpy.save({"theta": np.zeros(size, np.float32)}, metadata=METADATA))


@pytest.mark.parametrize("dtype", [np.float64, np.int32, np.uint8])
def test_load_of_a_theta_of_the_wrong_type_raises_corrupt_weights(dtype: type) -> None:
    with pytest.raises(CorruptWeights, match="F32"):
        load(safetensors_numpy.save({"theta": THETA.astype(dtype)}, metadata=METADATA))


@pytest.mark.parametrize(
    "tensors", [{}, {"weights": THETA}, {"theta": THETA, "more": THETA}, {"theta": THETA[None]}], ids=list
)
def test_load_with_other_tensors_raises_corrupt_weights(tensors: dict[str, npt.NDArray[np.float32]]) -> None:
    with pytest.raises(CorruptWeights, match="nothing else"):
        load(safetensors_numpy.save(tensors, metadata=METADATA))


@pytest.mark.parametrize("key", ["format", "spec", "model"])
def test_load_with_missing_metadata_raises_corrupt_weights(key: str) -> None:
    metadata = {name: value for name, value in METADATA.items() if name != key}
    with pytest.raises(CorruptWeights, match=key):
        load(assemble({"__metadata__": metadata, "theta": TENSOR}))


@pytest.mark.parametrize(
    "header",
    [
        {"theta": TENSOR},
        {"__metadata__": [], "theta": TENSOR},
        {"__metadata__": METADATA | {"format": "hof-theta-2"}, "theta": TENSOR},
        {"__metadata__": METADATA | {"model": 7}, "theta": TENSOR},
        {"__metadata__": METADATA | {"spec": {}}, "theta": TENSOR},
        {"__metadata__": METADATA | {"model": ""}, "theta": TENSOR},
        {"__metadata__": METADATA | {"model": "x" * 201}, "theta": TENSOR},
        {"__metadata__": METADATA | {"model": "a\0b"}, "theta": TENSOR},
        {"__metadata__": METADATA | {"model": "\ud800"}, "theta": TENSOR},
        {"__metadata__": METADATA | {"spec": TINY.to_json().replace("tiny", "\\ud800")}, "theta": TENSOR},
        {"__metadata__": METADATA, "theta": TENSOR | {"data_offsets": [4, 72]}},
        {"__metadata__": METADATA, "theta": None},
        [],
        7,
        b"{",
        b"\xff\xfe",
        b"[" * 10_000,
    ],
    ids=lambda header: str(header)[:60],
)
def test_load_with_a_bad_header_raises_corrupt_weights(header: object) -> None:
    with pytest.raises(CorruptWeights):
        load(assemble(header))


@pytest.mark.parametrize(
    "word", [None, "", "ab", "[", '["a"]', '["a","b","c"]', '["a",7]', '["a",""]', '["a","\\u0000"]', '{"a":1,"b":2}']
)
def test_load_with_a_bad_word_raises_corrupt_weights(word: str | None) -> None:
    metadata = METADATA | {"format": "hof-word-1"} | ({} if word is None else {"word": word})
    tensor = {"dtype": "F32", "shape": [2, 17], "data_offsets": [0, 136]}
    with pytest.raises(CorruptWeights):
        load(assemble({"__metadata__": metadata, "theta": tensor}, WORD.theta.tobytes()))


@pytest.mark.parametrize("theta", [THETA, np.stack([THETA] * 3), np.stack([THETA] * 2).T])
def test_load_of_a_word_with_thetas_of_another_shape_raises_corrupt_weights(theta: Array) -> None:
    metadata = METADATA | {"format": "hof-word-1", "word": '["a", "b"]'}
    with pytest.raises(CorruptWeights, match=r"\[2, 17\]"):
        load(safetensors_numpy.save({"theta": np.ascontiguousarray(theta)}, metadata=metadata))


@pytest.mark.parametrize("spec", ["", "{}", TINY.to_json().replace("[2]", "[0]"), '{"hidden":[99999999999]}'])
def test_load_with_a_bad_spec_raises_invalid_spec(spec: str) -> None:
    with pytest.raises(InvalidSpec):
        load(assemble({"__metadata__": METADATA | {"spec": spec}, "theta": TENSOR}))
