"""Matting in front of any background, on real pictures, with the shipped network."""

import hashlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np
import pytest
import skimage.data
from PIL import Image

from service.encoding.decode import decode
from service.encoding.encoder import Encoder
from service.encoding.framing import Framing, preprocess
from service.encoding.masks import TRACE
from service.encoding.matting import CACHED_MATTES, Matting, _square_around
from service.errors import InvalidModel, NoObjectFound
from service.settings import SHIPPED_MATTING, Settings
from service.storage.ids import encoded_id
from tests.support.photos import disc, image_file
from tests.support.server import running

FRAMING = Framing(size=64, foreground_ratio=0.85)
DEMO = Path(__file__).parents[3] / "demo"
COFFEE = (DEMO / "coffee.jpg").read_bytes()  # 600 x 400, a cup on a saucer on a table
WITH_SAUCER = (77, 18, 479, 390)  # what a person takes for its box, within some pixels
CUP_ALONE = (174, 17, 424, 326)
TEXTURES = ["brick", "grass", "gravel"]


def _matting(path: Path) -> Matting:
    matting = Matting.of(path, 1)
    assert matting is not None
    return matting


@pytest.fixture(scope="module", params=["u2net", "shipped"])
def file(request: pytest.FixtureRequest, u2net: Path) -> Path:
    return u2net if request.param == "u2net" else SHIPPED_MATTING


@pytest.fixture(scope="module")
def cup(file: Path) -> tuple[int, int, int, int]:
    """Return the box of what the network takes for the object."""
    return CUP_ALONE if file == SHIPPED_MATTING else WITH_SAUCER


@pytest.fixture(scope="module")
def matting(file: Path) -> Matting:
    return _matting(file)


@pytest.fixture(scope="module")
def shipped() -> Matting:
    return _matting(SHIPPED_MATTING)


def _texture(name: str) -> Image.Image:
    return Image.fromarray(getattr(skimage.data, name)()).convert("RGB")


def _over(name: str, texture: str) -> tuple[Image.Image, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    """Return a picture of the demo in front of a texture, and the mask of its object, (H, W)."""
    with Image.open(DEMO / name) as picture:
        ground = _texture(texture).resize(picture.size)
        ground.paste(picture, (0, 0), picture)
        return ground, np.asarray(picture)[..., 3] > 127


# --- the matte ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "texture", "least"),
    [("armchair.png", "grass", 0.95), ("armchair.png", "brick", 0.9), ("chair.png", "gravel", 0.9)],
)
def test_matte_of_a_photo_covers_the_object(matting: Matting, name: str, texture: str, least: float) -> None:
    photo, truth = _over(name, texture)
    matte = matting(photo) > 127
    assert (matte & truth).sum() / (matte | truth).sum() > least


@pytest.mark.parametrize("size", [(1, 1), (1, 900), (900, 1), (37, 501), (1024, 768)])
def test_matte_of_any_photo_has_its_size(matting: Matting, size: tuple[int, int]) -> None:
    matte = matting(decode(COFFEE).resize(size))
    assert matte.shape == (size[1], size[0])
    assert matte.dtype == np.uint8


def test_matte_of_a_repeated_photo_costs_no_inference(file: Path) -> None:
    matting = _matting(file)
    first = matting(decode(COFFEE))
    matting._network = None  # type: ignore[assignment] # would fail
    np.testing.assert_array_equal(matting(decode(COFFEE)), first)
    with pytest.raises(AttributeError):
        matting(disc())
    assert CACHED_MATTES * matting.side**2 < 10_000_000


def test_matte_on_many_threads_belongs_to_its_photo(file: Path) -> None:
    photos = [decode(COFFEE), disc()]
    alone = [_matting(file)(photo) for photo in photos]
    shared = _matting(file)
    with ThreadPoolExecutor(len(photos)) as pool:
        for matte, expected in zip(pool.map(shared, photos), alone, strict=True):
            np.testing.assert_array_equal(matte, expected)


def test_matte_of_a_small_object_is_looked_at_twice(shipped: Matting) -> None:
    ground = _texture("grass").resize((1024, 768))
    with Image.open(DEMO / "armchair.png") as picture:
        small = picture.resize((200, 200))
    ground.paste(small, (700, 500), small)
    truth = np.zeros((768, 1024), bool)
    truth[500:700, 700:900] = np.asarray(small)[..., 3] > 127
    matte, coarse = shipped(ground) > 127, shipped._look(ground) > 127
    overlaps = [(each & truth).sum() / (each | truth).sum() for each in (coarse, matte)]
    assert overlaps[1] > 0.9
    assert overlaps[1] > overlaps[0]


@pytest.mark.parametrize(
    ("object_", "expected"),
    [
        ((40, 60, 40, 60), (37, 37, 63, 63)),  # left, right, top, bottom; the margin on each side
        ((0, 20, 90, 100), (0, 74, 26, 100)),  # moved into the picture
        ((10, 110, 0, 100), (0, 0, 120, 100)),  # the square is larger than the picture
    ],
)
def test_square_around_an_object_lies_within_the_picture(
    object_: tuple[int, int, int, int], expected: tuple[int, int, int, int]
) -> None:
    left, right, top, bottom = object_
    matte = np.zeros((100, 120), np.uint8)
    matte[top:bottom, left:right] = 255
    assert _square_around(matte) == expected
    assert _square_around(np.zeros_like(matte)) is None


# --- the file -------------------------------------------------------------------------------------


def test_matting_digest_is_that_of_the_file(matting: Matting, file: Path) -> None:
    assert matting.digest == hashlib.sha256(file.read_bytes()).hexdigest()
    assert matting.is_u2net == (file.name == "u2netp.onnx")


def test_matting_without_a_path_is_none() -> None:
    assert Matting.of(None, 1) is None


def test_matting_of_a_missing_file_raises_and_downloads_nothing(tmp_path: Path) -> None:
    with pytest.raises(
        InvalidModel, match=r"cannot read the matting model .*gone\.onnx: No such file.* docs/operations"
    ):
        Matting.of(tmp_path / "gone.onnx", 1)
    assert list(tmp_path.iterdir()) == []


def test_matting_of_another_file_raises_invalid_model(tmp_path: Path, model_path: Path) -> None:
    cut = tmp_path / "cut.onnx"
    cut.write_bytes(SHIPPED_MATTING.read_bytes()[:100_000])
    with pytest.raises(InvalidModel, match=r"cut\.onnx is unusable: onnxruntime cannot load it"):
        Matting.of(cut, 1)
    with pytest.raises(InvalidModel, match=r"is unusable: it is neither U2-Net nor of `hof-model matte`: .*theta"):
        Matting.of(model_path, 1)


# --- framing by it --------------------------------------------------------------------------------


def test_preprocess_of_a_photo_with_a_background_cuts_the_object_out(
    matting: Matting, cup: tuple[int, int, int, int]
) -> None:
    framed = preprocess(COFFEE, FRAMING, matting=matting)
    assert (framed.mask, framed.width, framed.height) == ("matting", 600, 400)
    np.testing.assert_allclose(framed.box, cup, atol=10)
    assert framed.confidence is not None
    assert (0.8 if cup == CUP_ALONE else 0.97) < framed.confidence <= 1
    corners = framed.tensor[0][:, [0, 0, -1, -1], [0, -1, 0, -1]]
    assert corners.min() >= 1 - TRACE / 255  # the table is gone, but for a trace
    assert framed.tensor[0, :, 32, 32].min() < 0.9


@pytest.mark.parametrize("mode", ["L", "CMYK"])
def test_preprocess_of_gray_and_cmyk_photos_cuts_the_object_out(u2net: Path, mode: str) -> None:
    framed = preprocess(image_file(decode(COFFEE).convert(mode), "JPEG"), FRAMING, matting=_matting(u2net))
    assert framed.mask == "matting"
    np.testing.assert_allclose(framed.box, WITH_SAUCER, atol=12)


def test_preprocess_of_a_turned_photo_cuts_it_out_upright(matting: Matting, cup: tuple[int, int, int, int]) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    stored = decode(COFFEE).transpose(Image.Transpose.ROTATE_90)  # the camera's file: a viewer turns it by 270 degrees
    framed = preprocess(image_file(stored, "JPEG", exif=exif, quality=95), FRAMING, matting=matting)
    assert (framed.width, framed.height) == (600, 400)
    np.testing.assert_allclose(framed.box, cup, atol=10)


@pytest.mark.parametrize(("kind", "scale"), [("PNG", 3), ("JPEG", 7)])
def test_preprocess_of_a_large_photo_reports_its_own_pixels(
    matting: Matting, cup: tuple[int, int, int, int], kind: str, scale: int
) -> None:
    photo = decode(COFFEE).resize((600 * scale, 400 * scale))
    framed = preprocess(image_file(photo, kind), FRAMING, matting=matting)
    assert (framed.width, framed.height) == photo.size
    np.testing.assert_allclose(np.array(framed.box) / scale, cup, atol=10)


@pytest.mark.parametrize("name", TEXTURES)
def test_preprocess_of_a_texture_raises_no_object_found(matting: Matting, name: str) -> None:
    photo = image_file(_texture(name))
    assert preprocess(photo, FRAMING).mask == "none"  # only matting can tell
    with pytest.raises(NoObjectFound, match="no object found"):
        preprocess(photo, FRAMING, matting=matting)


def test_preprocess_prefers_alpha_and_a_uniform_border_to_matting(matting: Matting) -> None:
    assert preprocess((DEMO / "chair.png").read_bytes(), FRAMING, matting=matting).mask == "alpha"
    assert preprocess(image_file(disc()), FRAMING, matting=matting).mask == "border"


def test_preprocess_with_background_keep_takes_the_whole_photo(matting: Matting) -> None:
    framed = preprocess(COFFEE, FRAMING, "keep", matting=matting)
    assert (framed.mask, framed.box, framed.confidence) == ("none", (0, 0, 600, 400), None)


# --- over HTTP ------------------------------------------------------------------------------------


@pytest.fixture
def client(settings: Settings, file: Path) -> Iterator[httpx.Client]:
    with (
        running(settings.model_copy(update={"matting_model": file})) as server,
        httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client,
    ):
        yield client


def test_encode_answer_has_mask_box_and_confidence(client: httpx.Client, matting: Matting, model_path: Path) -> None:
    answer = client.post("/encode", content=COFFEE)
    item = answer.json()
    framed = preprocess(COFFEE, FRAMING, matting=matting)
    assert answer.status_code == 201
    assert item["image"] == {
        "mask": "matting",
        "box": list(framed.box),
        "confidence": pytest.approx(framed.confidence, abs=1e-3),
        "width": 600,
        "height": 400,
    }
    digests = (Encoder.open(model_path, 1).digest, matting.digest)
    assert (
        item["id"] == encoded_id(COFFEE, "matting", 0.85, *digests) != encoded_id(COFFEE, "matting", 0.85, digests[0])
    )


def test_encode_of_a_repeated_photo_is_200_without_inference(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = client.post("/encode", content=COFFEE).json()
    monkeypatch.setattr(Encoder, "encode", None)  # would fail
    monkeypatch.setattr(Matting, "_run", None)
    again = client.post("/encode?background=remove", content=COFFEE)
    assert (again.status_code, again.json()) == (200, first)


def test_encode_with_background_keep_is_another_object(client: httpx.Client) -> None:
    item = client.post("/encode", content=COFFEE).json()
    whole = client.post("/encode?background=keep", content=COFFEE)
    assert whole.status_code == 201
    assert whole.json()["image"]["mask"] == "none"
    assert whole.json()["id"] != item["id"]


@pytest.mark.parametrize("query", ["", "?background=remove", "?store=false"])
def test_encode_of_a_photo_without_an_object_is_422(client: httpx.Client, query: str) -> None:
    answer = client.post(f"/encode{query}", content=image_file(_texture("grass"), "JPEG"))
    problem = answer.json()
    assert (answer.status_code, problem["title"]) == (422, "No object found")
    assert [error["field"] for error in problem["errors"]] == ["image"]
    assert client.get("/objects").json()["items"] == []
