"""Measure ways to make a surface of an object: the service's way, and ways that start from points.

Every way starts from the same thetas, one view per object, and is measured by points drawn uniformly from its surface.
Parameters were chosen on the validation split, except MeshLab's, which were set once for this number of points.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import trimesh
from scipy import ndimage
from skimage.measure import marching_cubes
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from model.data.manifest import Split
from model.evaluation.conditions import png
from model.evaluation.evaluate import PREDICTED_POINTS, VIEWS, Case, cases, encode_photo
from model.metrics import compare
from model.provenance import provenance
from service.encoding.encoder import Encoder
from service.files import whole_file
from service.mapping.sampler import Sampler
from service.mapping.spec import word_of
from service.mapping.surface import shells, surface_of

Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.integer[Any]]
Way = Callable[[Sampler], tuple[Floats, Indices]]  # object -> vertices (v, 3) and triangles (t, 3)

CLOUD: Final = "its points"
SERVED: Final = "shells through f, cut"
METRICS: Final = ("f@1%", "f@2%")
STRIDE: Final = 3  # every third object of the split: MeshLab takes seconds per object
DENSE: Final = 200_000  # points in a grid
SPARSE: Final = 20_000  # points that are joined by triangles
CELLS: Final = 128  # along the longest side
SMOOTHING: Final = 0.7  # cells, standard deviation of the Gaussian over a grid
OUTSIDE: Final = 0.1  # share of the points outside the density's level
DISTANCE: Final = 0.01  # longest sides, between the points and a surface around them
DEPTH: Final = 7  # Poisson's octree
BALL: Final = 1.5  # the pivoting ball's radius, % of the bounding box's diagonal


@dataclass(frozen=True)
class Trial:
    """Measurements of one way, per object: F-scores, whether the surface is closed, triangles, CPU milliseconds."""

    way: str
    figures: dict[str, list[float]]
    closed: list[bool]
    triangles: list[int]
    ms: list[float]

    def mean(self, metric: str) -> float:
        """Return the metric's mean over objects."""
        return float(np.mean(self.figures[metric]))


@dataclass(frozen=True)
class Trials:
    """Trials of every way on the same objects; the first trial is the points themselves.

    origin : model, split, machine, date and commit. The file's key is `made`.
    """

    origin: dict[str, Any]
    trials: list[Trial]

    def write(self, path: Path) -> None:
        """Write as JSON, whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = ",\n  ".join(json.dumps(asdict(trial)) for trial in self.trials)
        with whole_file(path) as file:
            file.write(f'{{\n "made": {json.dumps(self.origin)},\n "trials": [\n  {rows}\n ]\n}}\n'.encode())

    @classmethod
    def read(cls, path: Path) -> "Trials":
        """Read a file that `write` wrote."""
        fields = json.loads(path.read_text(encoding="utf-8"))
        return cls(fields["made"], [Trial(**trial) for trial in fields["trials"]])


def through_f(sampler: Sampler) -> tuple[Floats, Indices]:
    """Make the surface as served."""
    surface = surface_of(sampler)
    return surface.vertices, surface.triangles


def whole_shells(sampler: Sampler) -> tuple[Floats, Indices]:
    """Make the surface as served, without cutting what f tears apart."""
    points, triangles = shells(sampler.domain, 64)
    return sampler.map(points), triangles


def one_icosphere(sampler: Sampler) -> tuple[Floats, Indices]:
    """Map the unit sphere alone, not cut; for a solid domain this is its border."""
    points, triangles = shells("sphere", 64)
    return sampler.map(points), triangles


def density(sampler: Sampler) -> tuple[Floats, Indices]:
    """Run marching cubes at a level of the points' smoothed density."""
    counts, cells, low, size = _grid(sampler.points(DENSE))
    smooth = ndimage.gaussian_filter(counts, SMOOTHING)
    return _march(smooth, float(np.quantile(smooth[tuple(cells.T)], OUTSIDE)), low, size)


def distance(sampler: Sampler) -> tuple[Floats, Indices]:
    """Run marching cubes at a distance from the nearest cell that holds a point."""
    counts, _, low, size = _grid(sampler.points(DENSE))
    nearest = ndimage.distance_transform_edt(counts == 0).astype(np.float32)
    return _march(ndimage.gaussian_filter(-nearest, SMOOTHING), -max(DISTANCE / size, 0.6), low, size)


def poisson(sampler: Sampler) -> tuple[Floats, Indices]:
    """Run MeshLab's screened Poisson (Kazhdan and Hoppe 2013), normals from 16 neighbors."""
    parameters: dict[str, object] = {"depth": DEPTH, "threads": 1, "preclean": True}
    return _meshlab(sampler.points(SPARSE), "generate_surface_reconstruction_screened_poisson", parameters)


def ball_pivoting(sampler: Sampler) -> tuple[Floats, Indices]:
    """Run MeshLab's ball pivoting (Bernardini et al. 1999)."""
    import pymeshlab

    parameters = {"ballradius": pymeshlab.PercentageValue(BALL)}
    return _meshlab(sampler.points(SPARSE), "generate_surface_reconstruction_ball_pivoting", parameters)


WAYS: Final[dict[str, Way]] = {
    SERVED: through_f,
    "shells through f, whole": whole_shells,
    "one icosphere through f": one_icosphere,
    "density, marching cubes": density,
    "distance, marching cubes": distance,
    "screened Poisson": poisson,
    "ball pivoting": ball_pivoting,
}


def measure_surfaces(model: Path, data: Path, split: Split, seed: int = 0) -> Trials:
    """Measure every way on one view of every third object of a split; BLAS on one thread.

    Raises
    ------
    FileNotFoundError : no data set.
    """
    encoder = Encoder.open(model, threads=1)
    objects = list(cases(data, split))[::STRIDE]
    samplers = [_sampler(encoder, case) for case in objects]
    with threadpool_limits(1):
        trials = [_points_trial(samplers, objects)]
        for way, make in WAYS.items():
            trials.append(_trial(way, make, samplers, objects, seed))
    origin = {"model": encoder.name, "split": split, "objects": len(objects), **provenance(seed)}
    return Trials(origin, trials)


def _sampler(encoder: Encoder, case: Case) -> Sampler:
    return Sampler(encoder.spec, word_of(encoder.spec, encode_photo(encoder, png(case.views[VIEWS[0]])).theta))


def _points_trial(samplers: Sequence[Sampler], objects: Sequence[Case]) -> Trial:
    timed = [_time(sampler.points, PREDICTED_POINTS) for sampler in samplers]
    figures = [compare(points, case.points) for (points, _), case in zip(timed, objects, strict=True)]
    return Trial(CLOUD, _columns(figures), [], [], [ms for _, ms in timed])


def _trial(way: str, make: Way, samplers: Sequence[Sampler], objects: Sequence[Case], seed: int) -> Trial:
    make(samplers[0])  # warm up: imports and caches
    figures, closed, triangles, times = [], [], [], []
    for sampler, case in tqdm(list(zip(samplers, objects, strict=True)), desc=way, unit="object", disable=None):
        (vertices, corners), ms = _time(make, sampler)
        mesh = trimesh.Trimesh(vertices, corners, process=False)
        points, _ = trimesh.sample.sample_surface(mesh, PREDICTED_POINTS, seed=seed)
        figures.append(compare(points.astype(np.float32), case.points))
        closed.append(bool(mesh.is_watertight))
        triangles.append(len(corners))
        times.append(ms)
    return Trial(way, _columns(figures), closed, triangles, times)


def _time(call: Callable[..., Any], *arguments: object) -> tuple[Any, float]:
    """Return the result of a call, and its CPU milliseconds."""
    started = time.process_time()
    result = call(*arguments)
    return result, round(1000 * (time.process_time() - started), 2)


def _columns(figures: Sequence[dict[str, float]]) -> dict[str, list[float]]:
    return {metric: [round(each[metric], 5) for each in figures] for metric in METRICS}


def _grid(points: Floats) -> tuple[Floats, npt.NDArray[np.int64], Floats, float]:
    """Return points per cell (a, b, c) float32, each point's cell (n, 3), the first cell's center, a cell's side."""
    margin = 4
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max()) / CELLS
    cells = np.rint((points - low) / size).astype(np.int64) + margin
    shape = cells.max(axis=0) + 1 + margin
    counts = np.bincount(np.ravel_multi_index(tuple(cells.T), tuple(shape)), minlength=int(np.prod(shape)))
    return counts.reshape(shape).astype(np.float32), cells, low - margin * size, size


def _march(field: Floats, level: float, low: Floats, size: float) -> tuple[Floats, Indices]:
    vertices, triangles, _, _ = marching_cubes(field, level)
    return (low + vertices * size).astype(np.float32), triangles


def _meshlab(points: Floats, name: str, parameters: dict[str, object]) -> tuple[Floats, Indices]:
    """Run a MeshLab filter on points (n, 3); return vertices and triangles."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points.astype(np.float64)))
    meshes.compute_normal_for_point_clouds(k=16, smoothiter=2)
    meshes.apply_filter(name, **parameters)
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix().astype(np.float32), mesh.face_matrix()
