"""Photos framed in Node as the service frames them: the same mask, the same box, nearly the same pixels."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import skimage.data
from PIL import Image, ImageDraw

from service.encoding.decode import decode
from service.encoding.encoder import Encoder
from service.encoding.framing import Framing, frame, preprocess
from service.encoding.matting import Matting
from service.encoding.pixels import over_white
from service.settings import SHIPPED_MATTING, SHIPPED_MODEL
from tests.client.js.conftest import Run
from tests.support import ROOT
from tests.support.photos import image_file

pytestmark = pytest.mark.system

SIZE, RATIO = 160, 0.85
LEVEL = 1 / 255
FRAME = """
import { readFile, writeFile } from "node:fs/promises";
import { frame } from "hof-client/encoder";
const [source, target, width, height, size, ratio] = process.argv.slice(1);
const data = new Uint8ClampedArray(await readFile(source));
const photo = { data, width: Number(width), height: Number(height) };
const { tensor, ...report } = await frame(photo, Number(size), Number(ratio));
await writeFile(target, tensor);
console.log(JSON.stringify(report));
"""


def _shape(mode: str, size: tuple[int, int], background: object, *, noise: int = 0) -> Image.Image:
    """Draw an ellipse with a hole on a background."""
    image = Image.new(mode, size, background)  # type: ignore[arg-type]
    width, height = size
    draw = ImageDraw.Draw(image)
    box = (width // 5, height // 7, 2 * width // 3, 6 * height // 7)
    draw.ellipse(
        box, fill=(180, 60, 40, 255)[: len(image.getbands())], outline=(20, 90, 60, 120)[: len(image.getbands())]
    )
    draw.rectangle((width // 3, height // 3, width // 2, height // 2), fill=background)  # type: ignore[arg-type]
    if noise:
        pixels = np.asarray(image).astype(int)
        pixels += np.random.default_rng(0).integers(-noise, noise + 1, pixels.shape)
        image = Image.fromarray(pixels.clip(0, 255).astype(np.uint8), mode)
    return image


def _framed(image: Image.Image) -> Image.Image:
    """Round off the corners with transparency, less than tells an object."""
    mask = Image.new("L", image.size, 0)
    ImageDraw.Draw(mask).rounded_rectangle((0, 0, image.width - 1, image.height - 1), radius=12, fill=255)
    result = image.convert("RGBA")
    result.putalpha(mask)
    return result


PHOTOS: dict[str, Callable[[], Image.Image]] = {
    **{
        path.stem: lambda path=path: decode(path.read_bytes())  # type: ignore[misc]
        for path in sorted((ROOT / "demo").glob("*.*g")) + sorted((ROOT / "service/viewer/static/photos").glob("*"))
    },
    "plain": lambda: _shape("RGB", (700, 500), (240, 238, 235), noise=3),
    "small": lambda: _shape("RGB", (61, 83), (255, 255, 255)),
    "transparent": lambda: _shape("RGBA", (640, 480), (0, 0, 0, 0)),
    "large and transparent": lambda: _shape("RGBA", (2501, 1703), (0, 0, 0, 0)),
    "large and plain": lambda: _shape("RGB", (1703, 2501), (30, 30, 34), noise=2),
    "rounded": lambda: _framed(_shape("RGB", (400, 300), (200, 210, 220))),
    "any background": lambda: _shape("RGB", (300, 400), (128, 128, 128), noise=90),
}


@pytest.mark.parametrize("name", PHOTOS)
def test_photo_is_framed_as_by_the_service(npm: Run, built: Path, tmp_path: Path, name: str) -> None:
    image = PHOTOS[name]()
    (tmp_path / "photo.rgba").write_bytes(image.convert("RGBA").tobytes())
    numbers = (*image.size, SIZE, RATIO)
    arguments = (str(tmp_path / "photo.rgba"), str(tmp_path / "tensor.f32"), *map(str, numbers))
    report = json.loads(npm("node", "--input-type=module", "--eval", FRAME, *arguments))
    crop = frame(image, Framing(SIZE, RATIO))
    assert (report["mask"], tuple(report["box"])) == (crop.mask, crop.box)
    assert report.get("confidence") == (crop.confidence and pytest.approx(crop.confidence, abs=1e-6))
    tensor = np.fromfile(tmp_path / "tensor.f32", np.float32).reshape(1, 3, SIZE, SIZE)
    difference = np.abs(tensor - over_white(crop.rgba))
    assert difference.max() <= 2.01 * LEVEL
    assert difference.mean() < 0.1 * LEVEL


MATTE = """
import { readFile, writeFile } from "node:fs/promises";
import { frame, Matting } from "hof-client/encoder";
const [source, model, target, seen, width, height, size, ratio] = process.argv.slice(1);
const data = new Uint8ClampedArray(await readFile(source));
const photo = { data, width: Number(width), height: Number(height) };
const matting = await Matting.open(new Uint8Array(await readFile(model)));
const matteOf = (image) => matting.matteOf(image);
await writeFile(target, await matteOf(photo)); // without the photo's transparency
const { tensor, whole, ...report } = await frame(photo, Number(size), Number(ratio), "auto", matteOf);
await writeFile(seen, whole ? Buffer.concat([tensor, whole].map(({ buffer }) => Buffer.from(buffer))) : tensor);
console.log(JSON.stringify(report));
"""
ENCODE = """
import { readFile, writeFile } from "node:fs/promises";
import { Encoder, Matting } from "hof-client/encoder";
const [source, matte, model, target, width, height] = process.argv.slice(1);
const data = new Uint8ClampedArray(await readFile(source));
const [matting, encoder] = [
  await Matting.open(new Uint8Array(await readFile(matte))),
  await Encoder.open(new Uint8Array(await readFile(model))),
];
const photo = { data, width: Number(width), height: Number(height) };
const { functions, shapeConfidence } = await encoder.encode(photo, "auto", (image) => matting.matteOf(image));
await writeFile(target, functions.rows[0]);
console.log(JSON.stringify({ shapeConfidence, color: [...functions.colorRows[0]] }));
"""
OVER_PHOTOGRAPHS: dict[str, Callable[[], Image.Image]] = {
    "cup": PHOTOS["coffee"],
    "chair on grass": lambda: _before("chair.png", skimage.data.grass(), (512, 512)),
    "small chair on gravel": lambda: _before("armchair.png", skimage.data.gravel(), (700, 500)),
    "chair at the edge": lambda: _before("chair.png", skimage.data.grass(), (512, 512)).crop((100, 150, 400, 480)),
    "rounded": lambda: _framed(_before("chair.png", skimage.data.grass(), (512, 512))),
}


def _before(name: str, ground: npt.NDArray[np.uint8], size: tuple[int, int]) -> Image.Image:
    """Return a picture of the demo in front of a texture."""
    picture = decode((ROOT / "demo" / name).read_bytes()).convert("RGBA").resize((240, 240))
    result = Image.fromarray(ground).convert("RGB").resize(size)
    result.paste(picture, (130, 170), picture)
    return result


@pytest.mark.parametrize("name", OVER_PHOTOGRAPHS)
def test_photo_before_any_background_is_cut_out_as_by_the_service(
    npm: Run, built: Path, tmp_path: Path, name: str
) -> None:
    image = OVER_PHOTOGRAPHS[name]()
    (tmp_path / "photo.rgba").write_bytes(image.convert("RGBA").tobytes())
    files = (str(tmp_path / "photo.rgba"), str(SHIPPED_MATTING), str(tmp_path / "matte"), str(tmp_path / "tensor.f32"))
    numbers = (*image.size, SIZE, RATIO)
    report = json.loads(npm("node", "--input-type=module", "--eval", MATTE, *files, *map(str, numbers)))
    matting = Matting.of(SHIPPED_MATTING, 1)
    assert matting is not None
    crop = frame(image, Framing(SIZE, RATIO), matting=matting)
    assert report["mask"] == crop.mask == "matting"
    np.testing.assert_allclose(report["box"], crop.box, atol=1)
    assert report["confidence"] == pytest.approx(crop.confidence, abs=1e-3)
    matte = np.fromfile(tmp_path / "matte", np.uint8).reshape(image.height, image.width)
    difference = np.abs(matte.astype(int) - matting(image.convert("RGB")))
    assert difference.mean() < 0.5
    assert np.quantile(difference, 0.999) <= 8
    looks = np.fromfile(tmp_path / "tensor.f32", np.float32).reshape(-1, 1, 3, SIZE, SIZE)
    expected = [over_white(each) for each in (crop.rgba, crop.whole) if each]
    assert len(expected) == (2 if name == "chair at the edge" else 1)
    for look, reference in zip(looks, expected, strict=True):
        assert np.abs(look - reference).mean() < 2 * LEVEL


@pytest.mark.parametrize("name", ["chair on grass", "chair at the edge"])
def test_photo_in_front_of_a_background_is_encoded_as_by_the_service(
    npm: Run, built: Path, tmp_path: Path, name: str
) -> None:
    image = OVER_PHOTOGRAPHS[name]()
    encoder, matting = Encoder.open(SHIPPED_MODEL, 1), Matting.of(SHIPPED_MATTING, 1)
    framed = preprocess(image_file(image), encoder.framing, matting=matting)
    assert len(framed.looks) == (2 if name == "chair at the edge" else 1)
    expected = encoder.encode_photo(framed)
    (tmp_path / "photo.rgba").write_bytes(image.convert("RGBA").tobytes())
    files = (str(tmp_path / "photo.rgba"), str(SHIPPED_MATTING), str(SHIPPED_MODEL), str(tmp_path / "theta"))
    answer = json.loads(npm("node", "--input-type=module", "--eval", ENCODE, *files, *map(str, image.size)))
    assert expected.estimates
    assert expected.color
    assert answer["shapeConfidence"] == pytest.approx(expected.estimates.shape_confidence, abs=5e-3)
    np.testing.assert_allclose(answer["color"], expected.color.weights, atol=0.02)
    np.testing.assert_allclose(np.fromfile(tmp_path / "theta", np.float32), expected.theta, atol=0.02)
