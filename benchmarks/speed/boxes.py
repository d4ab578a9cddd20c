"""Measure the error of an object's box, as the service measures it, against the box of ten million points.

`python -m benchmarks.speed.boxes > benchmarks/BOXES.md` writes the report: functions that the shipped models make of
photos, and words of two of them. It needs the data set of `hof-model data build`.
"""

import argparse
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from model.evaluation.conditions import png
from model.evaluation.evaluate import VIEWS, cases, encode_photo
from model.provenance import ROOT, provenance
from service.encoding.encoder import Encoder
from service.mapping.box import PROBE_POINTS, measure
from service.mapping.cloud import bounds
from service.mapping.frame import Frame
from service.mapping.sampler import sample
from service.mapping.spec import Array, MappingSpec, word_of
from service.settings import shipped_models

DATA: Final = ROOT / "data" / "sweethome3d"
PHOTOS: Final = tuple(ROOT / "demo" / name for name in ("armchair.png", "chair.png"))
POINTS_TO_COMPARE: Final = 10_000_000
WORDS: Final = 10  # for each model
HEAD: Final = (
    "| Functions | Count | Longest side in own numbers | Error of it, %: median | Error of it, %: largest "
    "| Error of any side, %: largest |\n|---|---|---|---|---|---|"
)


class Sides(NamedTuple):
    """The sides of one function's box: as measured, and of many points, (3,), in the function's own numbers."""

    measured: npt.NDArray[np.float64]
    drawn: npt.NDArray[np.float64]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the data set")
    parser.add_argument("--points", type=int, default=POINTS_TO_COMPARE, help="default: 10,000,000")
    arguments = parser.parse_args()
    run = provenance(0)
    print("# Error of an object's measured box\n")
    print(
        f"Written by `python -m benchmarks.speed.boxes`. {run['machine']}; {run['date']}, commit {run['commit']}. The "
        f"service evaluates {PROBE_POINTS:,} points to measure a box; here it is compared with the box of "
        f"{arguments.points:,} points. Errors are in percent of the longest side, without their sign. The photos are "
        f"view {VIEWS[0]} of each test object, and those of the demo; a word applies the functions of two test objects "
        "in turn.\n"
    )
    print(HEAD)
    encoders = (Encoder.open(path, 1) for path in shipped_models())
    for encoder in (each for each in encoders if each.takes == "image"):
        tests = [encode_photo(encoder, png(case.views[VIEWS[0]])).theta for case in cases(arguments.data, "test")]
        demos = [encode_photo(encoder, photo.read_bytes()).theta for photo in PHOTOS]
        for name, thetas in (("test photos", tests), ("demo photos", demos), ("words", list(_words(encoder, tests)))):
            sides = [_measure(encoder.spec, theta, arguments.points) for theta in thetas]
            print(_row(f"{encoder.name}: {name}", sides), flush=True)


def _words(encoder: Encoder, thetas: Sequence[Array]) -> Iterator[Array]:
    """Yield words of two functions in turn, (k, size)."""
    for pair in itertools.islice(itertools.pairwise(thetas), WORDS):
        yield np.stack([pair[i % 2] for i in range(encoder.spec.k)])


def _measure(spec: MappingSpec, theta: Array, points: int) -> Sides:
    drawn = Frame.of(*bounds(sample(spec, word_of(spec, theta), points)))
    return Sides(np.array(measure(spec, theta).sides), np.array(drawn.sides))


def _row(name: str, sides: Sequence[Sides]) -> str:
    measured, drawn = (np.stack(each) for each in zip(*sides, strict=True))  # (n, 3) each
    units = drawn.max(axis=1)
    longest = 100 * np.abs(measured.max(axis=1) / units - 1)
    any_side = 100 * np.abs(measured - drawn) / units[:, None]
    return (
        f"| {name} | {len(sides)} | {units.min():.2f} to {units.max():.2f} | {np.median(longest):.2f} "
        f"| {longest.max():.2f} | {any_side.max():.2f} |"
    )


if __name__ == "__main__":
    main()
