"""Measure the error of an object's box, as the service measures it, against the box of ten million points.

`python -m benchmarks.speed.boxes` draws functions of the shipped models from the demo's photos and from noise, and
words over them, and prints a line for each. A positive error means that the measured box is larger than the box of the
points: the search reaches further than points that are drawn at random.
"""

import argparse
import itertools
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.mapping.box import PROBE_POINTS, measure
from service.mapping.cloud import bounds
from service.mapping.frame import Frame
from service.mapping.sampler import sample
from service.mapping.spec import Array, MappingSpec, word_of
from service.settings import shipped_models

PHOTOS: Final = tuple(Path(__file__).resolve().parents[2] / "demo" / name for name in ("armchair.png", "chair.png"))
POINTS: Final = 10_000_000
NOISES: Final = 2  # images of colored discs on white, for each model


def main() -> None:
    """Print a table of errors, in percent of the longest side, and the time that measuring takes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=POINTS, help="points to compare with; default: 10,000,000")
    points = parser.parse_args().points
    print(f"{PROBE_POINTS:,} points are evaluated for a box, {points:,} to compare with")
    print("| Object | Longest side | Error of it, % | Largest error of a side, % | ms |\n|---|---|---|---|---|")
    errors = []
    for name, spec, theta in _objects():
        measure(spec, theta)  # compiles, where numba is installed
        start = time.perf_counter()
        frame = measure(spec, theta)
        milliseconds = 1000 * (time.perf_counter() - start)
        drawn = Frame.of(*bounds(sample(spec, word_of(spec, theta), points)))
        differences = (np.array(frame.sides) - np.array(drawn.sides)) / drawn.unit
        longest = frame.unit / drawn.unit - 1
        errors.append(abs(longest))
        worst = differences[np.argmax(np.abs(differences))]
        print(
            f"| {name} | {frame.unit:.3f} | {100 * longest:+.2f} | {100 * worst:+.2f} | {milliseconds:.1f} |",
            flush=True,
        )
    print(f"largest error of the longest side: {100 * max(errors):.2f} %")


def _objects() -> Iterator[tuple[str, MappingSpec, Array]]:
    """Yield objects of each shipped model: encoded ones, and words over two of them."""
    for path in shipped_models():
        encoder = Encoder.open(path, 1)
        tensors = [preprocess(photo.read_bytes(), encoder.framing).tensor for photo in PHOTOS]
        names = [photo.stem for photo in PHOTOS] + [f"disc {seed}" for seed in range(NOISES)]
        tensors += [_disc(encoder, seed) for seed in range(NOISES)]
        thetas = [encoder.encode(tensor)[0].theta for tensor in tensors]
        yield from ((f"{encoder.name}: {name}", encoder.spec, theta) for name, theta in zip(names, thetas, strict=True))
        for a, b in itertools.permutations(range(2), 2):
            word = [thetas[(a, b)[i % 2]] for i in range(encoder.spec.k)]
            yield f"{encoder.name}: {names[a]} and {names[b]} in turn", encoder.spec, np.stack(word)


def _disc(encoder: Encoder, seed: int) -> Array:
    """Draw a disc of a random color on white: (1, 3, size, size) float32."""
    image, rng = encoder.blank(), np.random.default_rng(seed)
    size = image.shape[-1]
    rows, columns = np.indices((size, size)) - size / 2
    inside = np.hypot(rows * rng.uniform(1, 2), columns) < 0.42 * size
    tensor = np.ones_like(image)
    tensor[0, :, inside] = rng.uniform(0, 1, 3)
    return tensor


if __name__ == "__main__":
    main()
