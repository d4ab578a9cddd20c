"""`hof encode` with several photos of one object gives what the service gives."""

import io
from pathlib import Path

import httpx
import numpy as np
import pytest

from service.cli.main import main
from tests.support.photos import disc, image_file


@pytest.fixture
def photos(here: Path) -> list[str]:
    (here / "other.png").write_bytes(image_file(disc("blue", at=(10, 20))))
    return ["photo.png", "other.png"]


def test_encode_of_several_photos_is_one_object(
    here: Path, photos: list[str], client: httpx.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["encode", photos[0], "--view", photos[1], "-o", "out.npy", "--n", "500"]) == 0
    first, second, last = capsys.readouterr().err.splitlines()
    assert first.startswith("hof: photo.png: mask by border")
    assert second.startswith("hof: other.png: mask by border")
    assert last == "hof: out.npy: 500 points"
    files = [("image", (name, (here / name).read_bytes())) for name in photos]
    item = client.post("/encode", files=files).json()
    served = client.get(f"{item['links']['points']}?n=500&format=npy").content
    np.testing.assert_allclose(np.load(here / "out.npy"), np.load(io.BytesIO(served)), atol=1e-6)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["photo.png"] * 9, "there are 9 photos, the limit is 8"),
        (["-", "-"], "- is named twice"),
        (["photo.png", "broken.png"], "broken.png: "),
        (["photo.png", "same.png"], "same.png is the same photo as photo.png"),
    ],
)
def test_encode_of_faulty_photos_fails(
    here: Path, names: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "broken.png").write_bytes((here / "photo.png").read_bytes()[:100])
    (here / "same.png").write_bytes((here / "photo.png").read_bytes())
    views = [flag for name in names[1:] for flag in ("--view", name)]
    assert main(["encode", names[0], *views, "-o", "out.ply"]) == 2
    assert message in capsys.readouterr().err
    assert not (here / "out.ply").exists()
