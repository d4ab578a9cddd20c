"""Effects of augmentation on a view."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as nnf
from torch import Tensor

from model.data.augment import ANY_LIGHT, PLAIN_SHARE, SHADOW_SHARE, WHITE_LIGHT, augment
from model.data.sources.photographs import photograph_files

IMAGES = 400
BUNDLED = photograph_files(Path("no folder"))


def square(color: tuple[int, int, int]) -> Tensor:
    """(IMAGES, 4, 32, 32) uint8: a square of 20 pixels in the middle."""
    crops = torch.zeros(IMAGES, 4, 32, 32, dtype=torch.uint8)
    crops[:, :, 6:26, 6:26] = torch.tensor([*color, 255], dtype=torch.uint8).view(4, 1, 1)
    return crops


@pytest.fixture(scope="module")
def images() -> Tensor:
    return augment(square((200, 40, 40)), 16, np.random.default_rng(0), BUNDLED)


def test_augment_images_have_the_encoders_size_and_range(images: Tensor) -> None:
    assert images.shape == (IMAGES, 3, 16, 16)
    assert images.dtype == torch.float32
    assert float(images.min()) >= 0
    assert float(images.max()) <= 1


def test_augment_equal_generator_gives_equal_images(images: Tensor) -> None:
    crops = square((200, 40, 40))
    assert (augment(crops, 16, np.random.default_rng(0), BUNDLED) == images).all()
    assert (augment(crops, 16, np.random.default_rng(1), BUNDLED) != images).any()
    assert (crops == square((200, 40, 40))).all()  # nothing is changed in place


def test_augment_grounds_are_white_for_half_and_varied_for_others(images: Tensor) -> None:
    corners = images[:, :, 0, 0]
    white = (corners == 1).all(dim=1)
    assert float(white.float().mean()) == pytest.approx(PLAIN_SHARE, abs=0.08)
    assert float(corners[~white].std(dim=0).min()) > 0.15
    ground = images[~white][:, :, :2]
    rough = ground.std(dim=(2, 3)).mean(dim=1)
    assert float(rough.min()) < 0.03  # flat
    assert float(rough.max()) > 0.15  # textures, photographs


def test_augment_objects_are_visible_and_some_images_gray(images: Tensor) -> None:
    middle = images[:, :, 7:9, 7:9].mean(dim=(2, 3))
    gray = (images.amax(dim=1) - images.amin(dim=1)).mean(dim=(1, 2)) < 0.1
    red = middle[:, 0] - middle[:, 1:].amax(dim=1)
    assert 0.02 < float(gray.float().mean()) < 0.2
    assert float((red[~gray] > 0.05).float().mean()) > 0.97


def test_augment_shadows_lie_at_the_foot_of_some_objects(images: Tensor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("model.data.augment.SHADOW_SHARE", 0.0)
    bright = augment(square((200, 40, 40)), 16, np.random.default_rng(0), BUNDLED)
    darker = (bright - images).mean(dim=1)  # (IMAGES, 16, 16)
    assert float(darker.min()) > -1e-6
    shaded = darker.amax(dim=(1, 2)) > 0.05
    assert 0.2 < float(shaded.float().mean()) < SHADOW_SHARE + 0.05
    by_row = darker.sum(dim=(0, 2))
    assert float(by_row[8:].sum()) > 10 * float(by_row[:8].sum())


def test_augment_zoom_and_shift_vary_and_cut_off_little(images: Tensor) -> None:
    white = (images[:, :, 0, 0] == 1).all(dim=1)
    widths = (images[white][:, 1, 8] < 0.75).sum(dim=1)  # of 10 pixels
    assert int(widths.min()) < 10 < int(widths.max())
    assert float((widths == 16).float().mean()) < 0.1


def test_photograph_files_demo_photo_is_left_out() -> None:
    assert "coffee.png" not in {path.name for path in BUNDLED}


def test_augment_textured_share_of_objects_is_rough(images: Tensor) -> None:
    def rough(batch: Tensor) -> Tensor:
        """Return the share of the images on white with an uneven object."""
        on_white = batch[(batch[:, :, 0, 0] == 1).all(dim=1)]
        smooth = nnf.avg_pool2d(on_white[:, :, 6:10, 6:10], 2)  # noise is less by half
        return (smooth.std(dim=(2, 3)).mean(dim=1) > 0.02).float().mean()

    bare = augment(square((200, 40, 40)), 16, np.random.default_rng(0), BUNDLED, replace(ANY_LIGHT, textured_share=0.0))
    assert float(rough(bare)) < 0.1
    more = float(rough(images) - rough(bare))
    assert 0.34 * ANY_LIGHT.textured_share < more < 1.1 * ANY_LIGHT.textured_share


def test_augment_white_light_keeps_the_objects_color() -> None:
    middle = augment(square((200, 100, 40)), 16, np.random.default_rng(0), BUNDLED, WHITE_LIGHT)[:, :, 8, 8]
    assert (255 * middle.mean(dim=0)).tolist() == pytest.approx([200, 100, 40], abs=8)
    assert (middle[:, 0] > middle[:, 1] + 0.2).all()
    assert (middle[:, 1] > middle[:, 2] + 0.08).all()
