"""The image encoder in 8-bit integers against float32, in onnxruntime: its speed, and how its objects differ.

`python -m benchmarks.speed.quantized` prints the table. A form is taken if it is 1.5 times as fast, and if its
F-score at 2% is within 1%; the score here is that of its points against float32's, for the photos of the load test.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
from onnx import numpy_helper
from onnxruntime import quantization

from benchmarks.load.photos import photos
from benchmarks.speed.timing import pin
from model.metrics import compare
from model.provenance import provenance
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.encoding.network import open_session
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, MappingSpec, word_of
from service.settings import SHIPPED_MODEL

PHOTOS: Final = 24  # all kinds
CALIBRATED_ON: Final = 16  # of them
BATCHES: Final = (1, 8)
POINTS: Final = 10_000
SCORE: Final = "f@2%"
ROUNDS: Final = 15


class _Images(quantization.CalibrationDataReader):  # type: ignore[misc]
    """The framed photos, one at a time, for calibration."""

    def __init__(self, images: Array) -> None:
        self._images = iter(images)

    def get_next(self) -> dict[str, Array] | None:
        """Return the next input, or None."""
        image = next(self._images, None)
        return None if image is None else {"image": image[None]}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    rounds: int = parser.parse_args().rounds
    pin()
    encoder = Encoder.open(SHIPPED_MODEL, threads=1)
    images = np.concatenate([preprocess(photo, encoder.framing).tensor for photo in islice(photos(), PHOTOS)])
    run = provenance(0)
    print(
        f"Printed by `python -m benchmarks.speed.quantized`. {run['machine']}; {run['date']}, commit {run['commit']}; "
        f"{encoder.name}, one core, least processor time of {rounds} rounds.\n"
    )
    heads = [f"ms an image, {batch} at a time" for batch in BATCHES]
    print(f"| form | {' | '.join(heads)} | times as fast | MB | F@2% of its points against float32's |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "float32.onnx"
        onnx.save(_with_float32_weights(onnx.load(SHIPPED_MODEL)), plain)
        expected, base = _clouds(encoder.spec, plain, images), 0.0
        for name, make in _forms(images).items():
            path = plain if make is None else Path(folder) / "form.onnx"
            if make:
                make(str(plain), str(path))
            times = [_ms(path, images[:batch], rounds) for batch in BATCHES]
            base = base or times[-1]
            pairs = zip(_clouds(encoder.spec, path, images), expected, strict=True)
            score = np.mean([compare(one, other)[SCORE] for one, other in pairs])
            figures = " | ".join(f"{ms:.2f}" for ms in times)
            print(f"| {name} | {figures} | {base / times[-1]:.2f} | {path.stat().st_size / 1e6:.1f} | {score:.3f} |")


def _forms(images: Array) -> dict[str, Callable[[str, str], None] | None]:
    """Return the ways to write a quantized file; None stands for the file itself."""

    def static(kind: Any) -> Callable[[str, str], None]:  # noqa: ANN401 - a class of onnxruntime, which has no types
        def make(source: str, target: str) -> None:
            reader = _Images(images[:CALIBRATED_ON])
            quantization.quantize_static(source, target, reader, quant_format=kind, per_channel=True)

        return make

    def dense(source: str, target: str) -> None:
        quantization.quantize_dynamic(source, target, op_types_to_quantize=["Gemm", "MatMul"], per_channel=True)

    return {
        "float32": None,
        "8 bits, the dense layers, ranges at run time": dense,
        "8 bits, all layers, calibrated (QDQ)": static(quantization.QuantFormat.QDQ),
        "8 bits, all layers, calibrated (QOperator)": static(quantization.QuantFormat.QOperator),
    }


def _with_float32_weights(model: onnx.ModelProto) -> onnx.ModelProto:
    """Return a model whose float16 weights are float32 already: the quantizer does not look behind their casts."""
    weights = {each.name: each for each in model.graph.initializer}
    casts = [node for node in model.graph.node if node.op_type == "Cast" and node.input[0] in weights]
    for cast in casts:
        values = numpy_helper.to_array(weights[cast.input[0]]).astype(np.float32)
        model.graph.initializer.append(numpy_helper.from_array(values, cast.output[0]))
        model.graph.node.remove(cast)
    for name in {cast.input[0] for cast in casts}:
        model.graph.initializer.remove(weights[name])
    return model


def _ms(path: Path, images: Array, rounds: int) -> float:
    """Return the processor time of an image, the least of the rounds."""
    session, times = open_session(path, 1), []
    for _ in range(rounds):
        before = time.process_time()
        session.run(None, {"image": images})
        times.append(time.process_time() - before)
    return 1000 * min(times) / len(images)


def _clouds(spec: MappingSpec, path: Path, images: Array) -> list[Array]:
    """Return the points of each photo's object, in the function's own numbers, of which the longest side is about 1."""
    session = open_session(path, 1)
    thetas = [session.run(["theta"], {"image": image[None]})[0][0] for image in images]
    return [Sampler(spec, word_of(spec, theta)).points(POINTS) for theta in thetas]


if __name__ == "__main__":
    main()
