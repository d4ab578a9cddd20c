"""Random procedural pieces, furniture and other things, for training only.

A few hundred real objects include too few chairs to learn chair legs from.
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import trimesh

from model.data.manifest import PIECES, SURFACE_POINTS, Manifest, texture_files
from model.data.procedural import curved, furnishings, seating, sofas, things
from model.data.procedural.primitives import MATERIALS, Rng, Solid, Triple, assemble
from model.data.procedural.textures import draw_texture, random_placement, wrap
from model.data.rendering.cameras import free_cameras
from model.data.rendering.render import shoot, stage
from model.data.rendering.surface import Floats, sample_surface
from model.data.rendering.visible import visible
from model.data.workers import run_with_report
from service.files import whole_file

DESIGNS: Final[dict[Callable[[Rng], list[Solid]], float]] = {  # and the probability of each
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
TEXTURED_SHARE: Final = 0.5  # of a piece's materials, if there are textures
WOODS: Final = ((0.72, 0.53, 0.34), (0.45, 0.28, 0.17), (0.25, 0.16, 0.11), (0.85, 0.74, 0.56), (0.93, 0.92, 0.9))


@dataclass(frozen=True)
class PieceJob:
    """One piece to make; it depends on (seed, number) and the textures only."""

    target: Path
    textures: list[Path]
    seed: int
    number: int
    views: int


def make(folder: Path, count: int, views: int, processes: int) -> dict[str, str]:
    """Write the missing ones of `count` pieces to the data set `folder`; return number -> failure.

    Raises
    ------
    FileNotFoundError : `folder` holds no finished data set.
    """
    seed = Manifest.read(folder).seed
    (folder / PIECES).mkdir(exist_ok=True)
    textures = texture_files(folder)
    jobs = [PieceJob(folder / PIECES / f"{number:05d}.npz", textures, seed, number, views) for number in range(count)]
    jobs = [job for job in jobs if not job.target.exists()]
    return run_with_report(render_piece, jobs, lambda job: job.target.stem, processes, "make", "piece").failures


def render_piece(job: PieceJob) -> None:
    """Make one piece and render it under free cameras (a worker process)."""
    rng = np.random.default_rng([job.seed, 2, job.number])
    parts = piece(rng, job.textures)
    points = visible_points(parts, rng)
    with closing(stage(parts, multisampling=False)) as plotter:
        views = shoot(plotter, free_cameras(job.views, train=True, rng=rng), points, rng)
    with whole_file(job.target) as file:
        np.savez_compressed(file, views=views, points=points)


def visible_points(parts: list[trimesh.Trimesh], rng: Rng) -> Floats:
    """Sample the visible surface uniformly by area: (SURFACE_POINTS, 3) float32.

    Overlapping solids have a third of their surface inside, where images show nothing and real furniture has none.
    """
    surface = sample_surface(parts, 4 * SURFACE_POINTS, rng)[0]
    outside = surface[visible(surface, surface)]
    return outside[np.arange(SURFACE_POINTS) % len(outside)]


def piece(rng: Rng, textures: list[Path]) -> list[trimesh.Trimesh]:
    """Make a random piece in the object frame; each of its materials has one color or one texture."""
    design = list(DESIGNS)[rng.choice(len(DESIGNS), p=list(DESIGNS.values()))]
    solids, colors = design(rng), _colors(rng)
    parts = assemble(solids, colors)
    for material in MATERIALS:
        if textures and rng.random() < TEXTURED_SHARE:
            image = draw_texture(textures, colors[material], rng)
            repeats, start = random_placement(rng)
            for part, (_, of_material) in zip(parts, solids, strict=True):
                if of_material == material:
                    wrap(part, image, repeats, start)
    return parts


def _colors(rng: Rng) -> dict[str, Triple]:
    """Choose a color for each material: woods and grays for frames, any color for cloth; some materials share one."""
    wood = _near(rng, WOODS[rng.integers(len(WOODS))])
    gray = _near(rng, (rng.random(),) * 3)
    colors = {}
    for material in MATERIALS:
        bright = rng.uniform(0.05, 0.95, 3)
        anything: Triple = tuple((bright.mean() + rng.random() * (bright - bright.mean())).tolist())
        likely = {"wood": wood, "leg": gray, "front": wood, "sheet": (0.92, 0.91, 0.88)}.get(material, anything)
        colors[material] = (wood, likely, likely, anything)[rng.integers(4)]
    return colors


def _near(rng: Rng, color: Triple) -> Triple:
    red, green, blue = np.clip(np.array(color) + rng.uniform(-0.08, 0.08, 3), 0.02, 1).tolist()
    return red, green, blue
