"""Furniture and other things made by rule, for training only: a few hundred real objects show too few chairs to learn
what a leg is."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import trimesh

from model.data.manifest import MADE, Manifest
from model.data.procedural import curved, furnishings, seating, sofas, things
from model.data.procedural.primitives import MATERIALS, Rng, Solid, Triple, assembled
from model.data.procedural.textures import any_place, drawn, texture_files, wrap
from model.data.rendering.cameras import free_cameras
from model.data.rendering.render import POINTS, shoot, stage
from model.data.rendering.surface import Floats, sample_surface
from model.data.rendering.visible import visible
from model.data.workers import run_with_progress
from service.files import whole_file

DESIGNS: Final[dict[Callable[[Rng], list[Solid]], float]] = {  # and how often each is drawn
    seating.chair: 0.13,
    seating.stool: 0.02,
    curved.tub: 0.1,
    curved.bucket: 0.04,
    sofas.sofa: 0.13,
    seating.bed: 0.09,
    seating.crib: 0.01,
    seating.table: 0.09,
    seating.desk: 0.03,
    furnishings.cabinet: 0.08,
    furnishings.shelf: 0.03,
    furnishings.lamp: 0.05,
    furnishings.vessel: 0.06,
    furnishings.basin: 0.02,
    furnishings.appliance: 0.02,
    things.thing: 0.05,
    things.plant: 0.02,
    things.figure: 0.02,
    things.opening: 0.01,
}
TEXTURED_SHARE: Final = 0.5  # of a piece's materials, where there are textures
WOODS: Final = ((0.72, 0.53, 0.34), (0.45, 0.28, 0.17), (0.25, 0.16, 0.11), (0.85, 0.74, 0.56), (0.93, 0.92, 0.9))


@dataclass(frozen=True)
class MadeJob:
    """One piece to make: a function of (seed, number) and the textures."""

    target: Path
    textures: list[Path]
    seed: int
    number: int
    views: int


def make(folder: Path, count: int, views: int, processes: int) -> dict[str, str]:
    """Write pieces 0 to `count` that are missing in the data set `folder`; return number -> failure.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set.
    """
    seed = Manifest.read(folder).seed
    (folder / MADE).mkdir(exist_ok=True)
    textures = texture_files(folder)
    jobs = [MadeJob(folder / MADE / f"{number:05d}.npz", textures, seed, number, views) for number in range(count)]
    jobs = [job for job in jobs if not job.target.exists()]
    return run_with_progress(render_made, jobs, lambda job: job.target.stem, processes, "make", "piece")


def render_made(job: MadeJob) -> None:
    """Make one piece and render it under free cameras (a worker process)."""
    rng = np.random.default_rng([job.seed, 2, job.number])
    parts = piece(rng, job.textures)
    points = seen_points(parts, rng)
    with closing(stage(parts, multisampling=False)) as plotter:
        views = shoot(plotter, free_cameras(job.views, train=True, rng=rng), points, rng)
    with whole_file(job.target) as file:
        np.savez_compressed(file, views=views, points=points)


def seen_points(parts: list[trimesh.Trimesh], rng: Rng) -> Floats:
    """(POINTS, 3) float32, uniform over the area that can be seen: solids that reach into each other have a third of
    theirs inside, where no image and no real piece has any."""
    surface = sample_surface(parts, 4 * POINTS, rng)[0]
    seen = surface[visible(surface, surface)]
    return seen[np.arange(POINTS) % len(seen)]


def piece(rng: Rng, textures: list[Path]) -> list[trimesh.Trimesh]:
    """A piece at random, in the object frame; each of its materials of one colour, or with one of the textures."""
    design = list(DESIGNS)[rng.choice(len(DESIGNS), p=list(DESIGNS.values()))]
    solids, colours = design(rng), _colours(rng)
    parts = assembled(solids, colours)
    for material in MATERIALS:
        if textures and rng.random() < TEXTURED_SHARE:
            image = drawn(textures, colours[material], rng)
            repeats, start = any_place(rng)
            for part, (_, of_material) in zip(parts, solids, strict=True):
                if of_material == material:
                    wrap(part, image, repeats, start)
    return parts


def _colours(rng: Rng) -> dict[str, Triple]:
    """A colour for each material: woods and greys for what carries, anything for cloth, some of them alike."""
    wood = _near(rng, WOODS[rng.integers(len(WOODS))])
    grey = _near(rng, (rng.random(),) * 3)
    found = {}
    for material in MATERIALS:
        bright = rng.uniform(0.05, 0.95, 3)
        anything: Triple = tuple((bright.mean() + rng.random() * (bright - bright.mean())).tolist())
        likely = {"wood": wood, "leg": grey, "front": wood, "sheet": (0.92, 0.91, 0.88)}.get(material, anything)
        found[material] = (wood, likely, likely, anything)[rng.integers(4)]
    return found


def _near(rng: Rng, colour: Triple) -> Triple:
    red, green, blue = np.clip(np.array(colour) + rng.uniform(-0.08, 0.08, 3), 0.02, 1).tolist()
    return red, green, blue
