"""Harder images: the effect of each condition on a view, and the service's answer."""

import io
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from model.data.manifest import Entry, Manifest
from model.evaluation.conditions import CONDITIONS, MARGIN, Condition, condition_views, photographs
from service.encoding.framing import Framing, preprocess
from tests.support.small import data as small_data


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_data.write(tmp_path_factory.mktemp("conditions") / "data", train=1, test=2)


@pytest.fixture(scope="module")
def entry(data: Path) -> Entry:
    return next(Manifest.read(data).of("test"))


def shown(data: Path, entry: Entry, condition: Condition, seed: int = 0) -> list[npt.NDArray[np.uint8]]:
    with np.load(data / entry.file) as arrays:
        photos = condition_views(data, entry, condition, arrays["views"][:3], seed)
    return [np.asarray(Image.open(io.BytesIO(photo))) for photo in photos]


def plain(data: Path, entry: Entry) -> npt.NDArray[np.uint8]:
    with np.load(data / entry.file) as arrays:
        views: npt.NDArray[np.uint8] = arrays["views"][:3]
    return views


def test_condition_views_plain_are_unchanged(data: Path, entry: Entry) -> None:
    assert (np.stack(shown(data, entry, "plain")) == plain(data, entry)).all()


def test_condition_views_other_cameras_are_the_rendered_variants(data: Path, entry: Entry) -> None:
    with np.load(data / "variants" / f"{entry.id}__0.npz") as arrays:
        expected = arrays["views"][[0, 3, 6, 9]]
    assert (np.stack(shown(data, entry, "other cameras")) == expected).all()
    with pytest.raises(FileNotFoundError, match="hof-model data vary"):
        shown(data, next(Manifest.read(data).of("train")), "other cameras")


@pytest.mark.parametrize("condition", ["flat color", "photograph"])
def test_condition_views_backgrounds_surround_the_object_and_differ_by_view(
    data: Path, entry: Entry, condition: Condition
) -> None:
    images = shown(data, entry, condition)
    for view, image in zip(plain(data, entry), images, strict=True):
        assert image.shape == (view.shape[0] + 2 * MARGIN, view.shape[1] + 2 * MARGIN, 3)
        middle, solid = image[MARGIN:-MARGIN, MARGIN:-MARGIN], view[..., 3] == 255
        assert (middle[solid] == view[..., :3][solid]).all()
        assert (len(np.unique(image[:MARGIN].reshape(-1, 3), axis=0)) == 1) == (condition == "flat color")
    assert not (images[0][0] == images[1][0]).all()
    assert all((a == b).all() for a, b in zip(images, shown(data, entry, condition), strict=True))
    assert not (images[0][0] == shown(data, entry, condition, seed=1)[0][0]).all()


def test_condition_views_gray_has_no_color_and_the_same_mask(data: Path, entry: Entry) -> None:
    for view, image in zip(plain(data, entry), shown(data, entry, "gray"), strict=True):
        assert (image[..., 0] == image[..., 1]).all()
        assert (image[..., 0] == image[..., 2]).all()
        assert (image[..., 3] == view[..., 3]).all()
        assert image[..., 0].std() > 0


@pytest.mark.parametrize("condition", CONDITIONS)
def test_condition_views_every_condition_is_accepted_by_the_service(
    data: Path, entry: Entry, condition: Condition
) -> None:
    masks = {"flat color": "border", "photograph": "none"}
    with np.load(data / entry.file) as arrays:
        for photo in condition_views(data, entry, condition, arrays["views"][:2], 0):
            framed = preprocess(photo, Framing(32))
            assert framed.mask == masks.get(condition, "alpha")


def test_photographs_held_out_are_three_color_images() -> None:
    assert len(photographs()) == 3
    assert all(photograph.shape[2] == 3 and photograph.std() > 30 for photograph in photographs())
