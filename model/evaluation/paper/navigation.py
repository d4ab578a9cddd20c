"""Experiment 9: collision-free paths, planned on predictions and checked against the truth (paper, path planning).

The cube [-1, 1]^3 is cut into CELLS^3 cells, and a cell is an obstacle if it holds a point. Start and goal are the ends
of d and -d, d = v / |v|_1, for random directions v. Paths move along the axes. Success is the share of pairs for which
a method gives a path and that path meets no obstacle of the truth; optimality is the mean length of the shortest free
path, divided by that of the method's, over its successes. The paper does not say which of several shortest paths its
search takes: here ties are broken at random, by the same seed for all methods.
"""

import multiprocessing
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from model.config import COMPARED_METHODS
from model.data.manifest import Split
from model.evaluation.classes import class_of
from model.evaluation.comparison import ELLIPSOID, ORACLE, RETRIEVAL, network_answer
from model.evaluation.conditions import png
from model.evaluation.evaluate import PREDICTED_POINTS, VIEWS, Case, cases, draw, encode_photo, in_threads
from model.evaluation.paper.record import PaperRecord, Trial, rounded
from model.evaluation.references.methods import Retrieval, Training, matched_ellipsoid
from model.provenance import provenance
from model.training.checkpoints import chosen_checkpoint, load_network
from service.encoding.encoder import Encoder
from service.mapping.box import measure
from service.mapping.sampler import Sampler
from service.mapping.spec import word_of
from service.planning.grid import Cells, Grid, Mask
from service.planning.search import RECTILINEAR, Graph

EXPERIMENT: Final = "paths"
CELLS: Final = 32
PAIRS: Final = 100
DENSE: Final = 100_000  # points
SHORTEST_L1: Final = "Shortest L1"
SABB: Final = "SABB"
AS_SERVED: Final = "in the object frame, as served"
FIGURES: Final = ("success", "optimality", "no path")

Floats = npt.NDArray[np.float32]
Cell = tuple[int, int, int]
Shapes = Callable[[Case, bytes], dict[str, Floats]]  # object, its photo -> points (n, 3), by method


@dataclass(frozen=True, eq=False)
class Job:
    """One object: the cells that the truth leaves free, and those that each method leaves free."""

    seed: tuple[int, ...]
    truth: Mask
    methods: Mapping[str, Mask]


def measure_paths(model: Path, data: Path, split: Split, seed: int = 0, runs: Sequence[Path] = ()) -> PaperRecord:
    """Plan paths around every object of a split on the predictions of each method.

    Parameters
    ----------
    runs : runs of any method, measured too; each is named as in Table 1, or else after its folder.

    Raises
    ------
    FileNotFoundError : no data set, or no checkpoint.
    """
    encoder, objects = Encoder.open(model, threads=1), list(cases(data, split))
    sources = [_references(data, seed), _predict(encoder), *(_predict_trained(run, seed) for run in runs)]

    def job(case: Case) -> Job:
        photo = png(case.views[VIEWS[0]])
        shapes = {name: points for source in sources for name, points in source(case, photo).items()}
        return job_of(case.points, shapes, (seed, *case.entry.id.encode()))

    jobs = in_threads(job, objects, "predictions")
    setting = {
        "split": split,
        "objects": len(objects),
        "view": VIEWS[0],
        "cells": CELLS,
        "pairs": PAIRS,
        "points": PREDICTED_POINTS,
    }
    origin = {"model": encoder.name, "digest": encoder.digest, **provenance(seed)}
    classes = [class_of(case.entry) for case in objects]
    return PaperRecord(EXPERIMENT, setting, origin, [case.entry.id for case in objects], classes, _trials(jobs))


def job_of(true: Floats, shapes: Mapping[str, Floats], seed: tuple[int, ...]) -> Job:
    """Return the job of an object: predictions, the free space (Shortest L1) and the bounding box (SABB) of the truth.

    Parameters
    ----------
    true : (m, 3), the true points.
    shapes : predicted points (n, 3), by method.
    """
    truth = Grid.of(true, CELLS).free
    box = np.ones_like(truth)
    low, high = _bounds(truth)
    box[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))] = False
    methods = {SHORTEST_L1: np.ones_like(truth), SABB: box}
    return Job(seed, truth, methods | {name: Grid.of(points, CELLS).free for name, points in shapes.items()})


def navigate(job: Job) -> dict[str, tuple[float, float, float]]:
    """Return success, optimality (NaN without a success) and the share without a path, by method."""
    pairs = _pairs(job.truth, np.random.default_rng(job.seed))
    shortest = [_moves(path) for path in _plan(job.truth, pairs, job.seed)]
    figures = {}
    for method, free in job.methods.items():
        ratios, failed = [], 0
        for best, path in zip(shortest, _plan(free, pairs, job.seed), strict=True):
            if path is None:
                failed += 1
            elif job.truth[tuple(path.T)].all():
                ratios.append(best / _moves(path))
        figures[method] = (len(ratios) / PAIRS, float(np.mean(ratios)) if ratios else np.nan, failed / PAIRS)
    return figures


def _trials(jobs: Sequence[Job]) -> list[Trial]:
    """Plan all jobs, in processes: the searches are many short NumPy calls."""
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn")) as processes:
        results = list(tqdm(processes.map(navigate, jobs), total=len(jobs), desc="paths", unit="object", disable=None))
    return [
        Trial(method, {name: rounded([each[method][at] for each in results]) for at, name in enumerate(FIGURES)})
        for method in results[0]
    ]


def _pairs(truth: Mask, rng: np.random.Generator) -> list[tuple[Cell, Cell]]:
    """Draw pairs of start and goal outside the bounding box of the truth, so that each has a path around it."""
    low, high = _bounds(truth)
    pairs: list[tuple[Cell, Cell]] = []
    while len(pairs) < PAIRS:
        v = rng.normal(size=3)
        d = CELLS / 2 * v / np.abs(v).sum()
        ends = [np.clip(np.floor(end + CELLS / 2).astype(int), 0, CELLS - 1) for end in (d, -d)]
        if all(((end < low) | (end > high)).any() for end in ends):
            start, goal = ((int(x), int(y), int(z)) for x, y, z in ends)
            pairs.append((start, goal))
    return pairs


def _plan(free: Mask, pairs: Sequence[tuple[Cell, Cell]], seed: tuple[int, ...]) -> list[Cells | None]:
    """Return a shortest path of each pair, None where start or goal is an obstacle, or no path joins them."""
    graph = Graph(free, RECTILINEAR)
    return [
        graph.path(start, goal, np.random.default_rng([*seed, index])) if free[start] and free[goal] else None
        for index, (start, goal) in enumerate(pairs)
    ]


def _moves(path: Cells | None) -> int:
    if path is None:
        raise ValueError("the truth has no path between cells outside its box")
    return len(path) - 1


def _bounds(free: Mask) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the first and the last cells of the obstacles' box, (3,) and (3,)."""
    obstacles = np.argwhere(~free)
    return obstacles.min(axis=0), obstacles.max(axis=0)


def _predict(encoder: Encoder) -> Shapes:
    """Return the encoder's predictions: in the function's own numbers, as in RESULTS.md, and as served."""

    def shapes(case: Case, photo: bytes) -> dict[str, Floats]:
        theta = encode_photo(encoder, photo).theta
        dense = draw(encoder.spec, theta, DENSE)
        framed = Sampler(encoder.spec, word_of(encoder.spec, theta), measure(encoder.spec, theta))
        return {
            encoder.name: dense[:PREDICTED_POINTS],
            f"{encoder.name}, {DENSE:,} points": dense,
            f"{encoder.name}, {AS_SERVED}": framed.points(PREDICTED_POINTS),
        }

    return shapes


def _predict_trained(run: Path, seed: int) -> Shapes:
    """Return the predictions of a trained network that is not exported."""
    network, config, state = load_network(chosen_checkpoint(run))
    answer, steps = network_answer(run, network, config, seed), config.steps or state["step"]
    names = (each.name for each in COMPARED_METHODS if (each.method, each.spec) == (config.method, config.spec))
    name = f"{next(names, run.name)}, {steps:,} steps"
    return lambda case, photo: {name: answer(photo, PREDICTED_POINTS)}


def _references(data: Path, seed: int) -> Shapes:
    """Return training objects: the one whose picture is most similar, the nearest one; and the matched ellipsoid."""
    training = Training.read(data)
    retrieval = Retrieval(data, training)
    return lambda case, photo: {
        ELLIPSOID: matched_ellipsoid(case.points, seed),
        RETRIEVAL: retrieval(photo, PREDICTED_POINTS),
        ORACLE: training.oracle(case.points),
    }
