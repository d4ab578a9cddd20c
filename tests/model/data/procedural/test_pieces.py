"""Procedural pieces: whole pieces of every design, equal for equal numbers."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from model import cli
from model.config import TrainConfig
from model.data.build import build
from model.data.dataset import PIECES_PER_DRAW, draw_batch, load_examples
from model.data.manifest import SIZE, SURFACE_POINTS
from model.data.procedural import curved, pieces, seating
from model.data.procedural.primitives import MATERIALS, Solid, assemble, between, box, cushion, lathe, lean, rod
from model.data.sources.meshes import folder_records
from tests.support.small.shapes import write_folder

VIEWS = 2
COLOURS = dict.fromkeys(MATERIALS, (0.5, 0.5, 0.5))


@pytest.mark.parametrize("design", pieces.DESIGNS, ids=lambda design: design.__name__)
def test_design_any_seed_stands_whole_in_the_object_frame(design: Callable[[np.random.Generator], list[Solid]]) -> None:
    shapes = set()
    for seed in range(40):
        parts = assemble(design(np.random.default_rng(seed)), COLOURS)
        corners = np.concatenate([part.vertices for part in parts])
        low, high = corners.min(axis=0), corners.max(axis=0)
        assert np.isfinite(corners).all()
        assert low + high == pytest.approx(np.zeros(3), abs=1e-6)
        assert (high - low).max() == pytest.approx(1)
        assert (high - low).min() > 0.02, seed
        shapes.add(tuple((high - low).round(3)))
    assert len(shapes) > 30  # of 40 draws


@pytest.mark.parametrize("design", [seating.chair, curved.tub, curved.bucket])
def test_chair_any_seed_has_its_back_behind(design: Callable[[np.random.Generator], list[Solid]]) -> None:
    """Front is +Z: the top of a chair lies behind its middle."""
    behind = []
    for seed in range(40):
        parts = assemble(design(np.random.default_rng(seed)), COLOURS)
        corners = np.concatenate([part.vertices for part in parts])
        behind.append(corners[corners[:, 1] > 0.9 * corners[:, 1].max(), 2].mean() < 0)
    assert all(behind)


@pytest.mark.parametrize("end", [(0.3, 1.0, -0.2), (0.0, -2.0, 0.0), (1.0, 0.0, 0.0)])
def test_rod_two_points_reaches_from_one_to_the_other(end: tuple[float, float, float]) -> None:
    mesh, _ = rod((0, 0, 0), end, (0.2, 0.1), "leg")
    along = np.asarray(mesh.vertices) @ np.array(end) / np.linalg.norm(end)
    assert (along.min(), along.max()) == pytest.approx((0, np.linalg.norm(end)), abs=1e-6)
    off = np.linalg.norm(np.cross(mesh.vertices, end), axis=1) / np.linalg.norm(end)
    assert off[along < 1e-6].max() == pytest.approx(0.2)
    assert off[along > np.linalg.norm(end) - 1e-6].max() == pytest.approx(0.1)


def test_box_and_cushion_corners_are_filled() -> None:
    low, high = (-1.0, 0.0, 2.0), (1.0, 3.0, 2.5)
    for mesh, _ in (box(low, high, "wood"), cushion(low, high, "cloth", 0.3), cushion(low, high, "cloth", 1)):
        assert mesh.bounds == pytest.approx(np.array([low, high]), abs=1e-2)
        assert mesh.is_watertight
    bowl, _ = lathe([(0, 0), (0.5, 1.0), (0.4, 1.0), (0, 0.2)], "top", (3, 0, 0))
    assert bowl.bounds == pytest.approx(np.array([(2.5, 0, -0.5), (3.5, 1, 0.5)]), abs=1e-2)
    moved, _ = lean([box((0, 0, 0), (1, 2, 1), "wood")], 0.5, 1.0)[0]
    assert moved.bounds[:, 2].tolist() == pytest.approx([-0.5, 1])


def test_between_two_grids_fills_the_space() -> None:
    x, y = np.meshgrid(np.linspace(0, 2, 5), np.linspace(0, 3, 4))
    front, back = np.stack([x, y, 0 * x], axis=-1), np.stack([x, y, 0 * x - 0.5], axis=-1)
    for one, other in ((front, back), (back, front)):
        wall, _ = between(one, other, "cloth")
        assert wall.is_watertight
        assert wall.volume == pytest.approx(3)
        assert wall.bounds == pytest.approx(np.array([(0, 0, -0.5), (2, 3, 0)]))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    records = list(folder_records(write_folder(folder / "meshes"), "CC0"))[:6]
    build(records, folder / "set", seed=0, processes=1)
    return folder / "set"


def test_draw_batch_with_pieces_includes_them(data: Path) -> None:
    config = TrainConfig(batch=90, points=8, target_points=16)
    with pytest.raises(FileNotFoundError, match="hof-model data make --data"):
        load_examples(data, "train", config.framing, pieces=True)
    pieces = PIECES_PER_DRAW + 1
    assert cli.main(["data", "make", "--data", str(data), "--pieces", str(pieces), "--views", str(VIEWS)]) == 0
    files = sorted((data / "made").glob("*.npz"))
    written = [np.load(file) for file in files]
    assert [len(arrays["views"]) for arrays in written] == [VIEWS] * pieces
    assert all(arrays["views"].shape[1:] == (SIZE, SIZE, 4) for arrays in written)
    assert all((arrays["views"][..., 3] > 0).any(axis=(1, 2)).all() for arrays in written)
    assert all(np.abs(arrays["points"]).max() == pytest.approx(0.5, abs=0.05) for arrays in written)

    plain, examples = (
        load_examples(data, "train", config.framing, pieces=with_pieces) for with_pieces in (False, True)
    )
    assert plain.pieces == []
    assert [len(pieces) for pieces in examples.pieces] == [PIECES_PER_DRAW, 1]
    of_pieces = {tuple(np.abs(point)) for arrays in written for point in arrays["points"]}
    shares = [
        np.mean([tuple(np.abs(points[0].numpy())) in of_pieces for points in draw_batch(source, config, 0).points])
        for source in (plain, examples)
    ]
    assert shares == [0, pytest.approx(2 / (len(plain.entries) + 2), abs=0.02)]


def test_render_piece_equal_seed_and_number_gives_equal_arrays(data: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        pieces.render_piece(pieces.PieceJob(tmp_path / f"{name}.npz", [], seed=0, number=3, views=VIEWS))
    first, again = (dict(np.load(tmp_path / f"{name}.npz")) for name in ("a", "b"))
    assert (first["points"] == again["points"]).all()
    assert first["points"].shape == (SURFACE_POINTS, 3)
    assert (first["views"] == again["views"]).all()
