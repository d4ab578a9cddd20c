"""Augmentation on the device against that of the CPU loop: the same distributions."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from model.data import augment as cpu
from model.data.augment import ANY_LIGHT, PLAIN_SHARE, WHITE_LIGHT, Light
from model.data.sources.photographs import photograph_files
from model.training.device.augment import Grounds, augment
from model.training.device.pictures import Pictures, photograph_pictures, texture_pictures

IMAGES, SIZE = 2_400, 16
CPU = torch.device("cpu")
FILES = photograph_files(Path("no folder"))[:4]


def square(color: tuple[int, int, int]) -> Tensor:
    """(IMAGES, 32, 32, 4) uint8: a square of 20 pixels in the middle."""
    crops = torch.zeros(IMAGES, 32, 32, 4, dtype=torch.uint8)
    crops[:, 6:26, 6:26] = torch.tensor([*color, 255], dtype=torch.uint8)
    return crops


@pytest.fixture(scope="module")
def grounds() -> Grounds:
    photographs = []
    for path in FILES:
        with Image.open(path) as file:
            photographs.append(file.convert("RGB"))
    return Grounds(texture_pictures(SIZE, CPU), photograph_pictures(photographs, SIZE, CPU))


def both(grounds: Grounds, color: tuple[int, int, int], light: Light) -> tuple[Tensor, Tensor]:
    """Images of the device's and of the CPU loop's augmentation."""
    torch.manual_seed(0)
    crops = square(color)
    ours = augment(crops, SIZE, grounds, light)
    theirs = cpu.augment(crops.permute(0, 3, 1, 2), SIZE, np.random.default_rng(0), FILES, light)
    return ours, theirs


def figures(images: Tensor) -> dict[str, float]:
    """Means and spreads that tell the families of changes apart."""
    corners, middle = images[:, :, 0, 0], images[:, :, 6:10, 6:10]
    white = (corners == 1).all(dim=1)
    on_white = images[white]
    foot = images[~white][:, :, -3:].mean(dim=(1, 2, 3)) - images[~white][:, :, :3].mean(dim=(1, 2, 3))
    return {
        "white": float(white.float().mean()),
        "ground": float(corners[~white].mean()),
        "ground spread": float(corners[~white].std()),
        "ground colors": float(corners[~white].std(dim=1).mean()),
        "ground roughness": float(images[~white][:, :, :2].std(dim=(2, 3)).mean()),
        "foot": float(foot.mean()),
        "object": float(middle.mean()),
        "object spread": float(middle.mean(dim=(1, 2, 3)).std()),
        "object roughness": float(middle.std(dim=(2, 3)).mean()),
        "object saturation": float((middle.amax(dim=1) - middle.amin(dim=1)).mean()),
        "grey": float(((images.amax(dim=1) - images.amin(dim=1)).mean(dim=(1, 2)) < 0.1).float().mean()),
        "size": float((on_white[:, 1] < 0.75).float().mean()),
        "size spread": float((on_white[:, 1] < 0.75).float().mean(dim=(1, 2)).std()),
        "edge": float((on_white[:, :, 8, 1:] - on_white[:, :, 8, :-1]).abs().amax(dim=(1, 2)).mean()),
    }


@pytest.mark.parametrize("light", [ANY_LIGHT, WHITE_LIGHT])
def test_augment_on_the_device_has_the_distributions_of_the_cpu_loop(grounds: Grounds, light: Light) -> None:
    ours, theirs = both(grounds, (200, 40, 40), light)
    assert ours.shape == theirs.shape == (IMAGES, 3, SIZE, SIZE)
    assert 0 <= float(ours.min()) <= float(ours.max()) <= 1
    expected = figures(theirs)
    assert figures(ours) == pytest.approx(expected, rel=0.1, abs=0.025)
    assert expected["white"] == pytest.approx(PLAIN_SHARE, abs=0.04)


def test_augment_repeats_with_the_seed_and_changes_nothing_in_place(grounds: Grounds) -> None:
    crops = square((9, 99, 9))
    images = []
    for seed in (1, 1, 2):
        torch.manual_seed(seed)
        images.append(augment(crops, SIZE, grounds))
    assert torch.equal(images[0], images[1])
    assert not torch.equal(images[0], images[2])
    assert torch.equal(crops, square((9, 99, 9)))


def test_augment_without_photographs_draws_other_grounds(grounds: Grounds) -> None:
    images = augment(square((9, 99, 9)), SIZE, Grounds(grounds.textures, None))
    assert torch.isfinite(images).all()


def test_pieces_are_squares_of_the_pictures_flipped_half_of_the_time() -> None:
    torch.manual_seed(0)
    pictures = []
    for number, (height, width) in enumerate(((5, 9), (8, 4))):
        rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
        pictures.append(torch.stack([torch.full_like(rows, number), rows, columns], dim=2))
    pieces = Pictures.join(pictures, CPU).pieces(400, 4)
    assert pieces.shape == (400, 3, 4, 4)
    picture, row, column = pieces.unbind(1)
    assert (picture == picture[:, :1, :1]).all()
    assert (row.diff(dim=1) == 1).all()
    steps = column.diff(dim=2)
    assert (steps == steps[:, :1, :1]).all()
    assert float((steps[:, 0, 0] < 0).float().mean()) == pytest.approx(0.5, abs=0.1)
    corners = {
        (int(a), int(b), int(c)) for a, b, c in zip(picture[:, 0, 0], row[:, 0, 0], column.amin(2)[:, 0], strict=True)
    }
    assert corners == {(0, r, c) for r in range(2) for c in range(6)} | {(1, r, 0) for r in range(5)}
