"""Pictures to learn mattes from: what is object in them, and where."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from model.data.rendering.composites import EMPTY_SHARE, FAR_ZOOM, Composites
from model.data.sources.photographs import listed, photograph_files, scenery_files, surface_files

COUNT, SIDE = 300, 64


def _square() -> Composites:
    """Return composites of a red square that fills 94% of its view, as renders do."""
    views = np.zeros((1, 64, 64, 4), np.uint8)
    views[:, 2:62, 2:62] = (220, 30, 30, 255)
    nowhere = Path("no folder")
    return Composites(views, photograph_files(nowhere), scenery_files(nowhere))


@pytest.fixture(scope="module")
def drawn() -> tuple[Tensor, Tensor]:
    return _square().draw(COUNT, SIDE, np.random.default_rng(0))


def test_composites_have_the_side_and_range(drawn: tuple[Tensor, Tensor]) -> None:
    pictures, mattes = drawn
    assert (pictures.shape, mattes.shape) == ((COUNT, 3, SIDE, SIDE), (COUNT, 1, SIDE, SIDE))
    for each in drawn:
        assert (each.dtype, float(each.min()) >= 0, float(each.max()) <= 1) == (torch.float32, True, True)


def test_composites_of_an_equal_generator_are_equal(drawn: tuple[Tensor, Tensor]) -> None:
    again = _square().draw(COUNT, SIDE, np.random.default_rng(0))
    assert all((one == other).all() for one, other in zip(drawn, again, strict=True))
    assert (_square().draw(COUNT, SIDE, np.random.default_rng(1))[0] != drawn[0]).any()


def test_composites_show_small_and_large_objects_and_some_none(drawn: tuple[Tensor, Tensor]) -> None:
    share = drawn[1].mean(dim=(1, 2, 3)).numpy()
    assert (share == 0).mean() == pytest.approx(EMPTY_SHARE, abs=0.03)
    assert share[share > 0].min() < 2 * FAR_ZOOM[0] ** 2
    assert share.max() > 0.6


def test_composites_differ_from_their_ground_where_the_matte_is(drawn: tuple[Tensor, Tensor]) -> None:
    pictures, mattes = drawn
    plain = [number for number in range(COUNT) if float(mattes[number].mean()) > 0.05]
    apart = []
    for number in plain:
        inside = mattes[number, 0] > 0.99
        outside = mattes[number, 0] < 0.01
        apart.append(float((pictures[number][:, inside].mean(1) - pictures[number][:, outside].mean(1)).abs().max()))
    assert np.median(apart) > 0.15


def test_scenery_is_a_part_of_the_photographs_without_their_objects(tmp_path: Path) -> None:
    files = scenery_files(tmp_path)
    assert set(files) < set(photograph_files(tmp_path))
    assert {path.name for path in files} <= set(listed()["scenery"])
    assert {"astronaut.png", "chelsea.png", "motorcycle_left.png"}.isdisjoint(path.name for path in files)


def test_surfaces_are_the_textures_that_are_alike_all_over(tmp_path: Path) -> None:
    (tmp_path / "textures").mkdir()
    rng = np.random.default_rng(0)
    even = rng.integers(90, 160, (200, 150, 3))
    uneven = even + np.linspace(-80, 80, 150).astype(int)[:, None]
    for name, pixels in (("even", even), ("uneven", uneven), ("small", even[:100, :100])):
        Image.fromarray(pixels.astype(np.uint8)).save(tmp_path / "textures" / f"{name}.jpg")
    assert [path.stem for path in surface_files(tmp_path)] == ["even"]
    assert surface_files(tmp_path / "nowhere") == ()


def test_composites_with_surfaces_have_them_behind_half_of_the_objects(tmp_path: Path) -> None:
    Image.new("RGB", (200, 200), (0, 255, 0)).save(tmp_path / "green.png")
    shown = replace(_square(), surfaces=(tmp_path / "green.png",))
    green = shown._grounds(torch.arange(COUNT) % 2 == 0, SIDE, np.random.default_rng(0))
    plain = _square()._grounds(torch.arange(COUNT) % 2 == 0, SIDE, np.random.default_rng(0))
    alike = [each.std(dim=(2, 3)).amax(dim=1) < 1e-3 for each in (green, plain)]
    assert alike[0].float().mean() > alike[1].float().mean() + 0.1
