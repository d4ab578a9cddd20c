"""Memory for decoding a photo at the pixel limit, measured in a process of its own for each mode.

The limit is that of `hof serve` where it says so, else a quarter of it: memory grows with the pixels.
"""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from service.encoding.decode import DEFAULT_MAX_PIXELS, WORKING_BYTES
from service.settings import MIB
from tests.support import ROOT
from tests.support.photos import image_file, png_chunk, png_file

pytestmark = pytest.mark.server

MATTING_BYTES = 275 * 10**6  # docs/operations.md; tests/project/test_deploy.py reckons with 275 MiB
MATTING = """
import sys
from pathlib import Path
from PIL import Image
from service.encoding.matting import Matting
from tests.support.resources import reset_peak, status_bytes

matting = Matting.of(Path(sys.argv[1]), int(sys.argv[2]))
photo = Image.effect_noise((400, 300), 90).convert("RGB")
matting(photo)
reset_peak("self")
before = status_bytes("self", "VmRSS")
matting(photo.rotate(90))
print(status_bytes("self", "VmHWM") - before, status_bytes("self", "VmRSS") - before)
"""
QUARTER = (4_000, 2_000)
WHOLE = (8_000, 4_000)
SLACK_BYTES = 16 * MIB  # of the file and of small buffers; a file of 20 MiB comes on top
MEASURE = """
import sys
from pathlib import Path
from service.encoding.decode import configure_pillow
from service.encoding.framing import Framing, preprocess
from service.errors import NoObjectFound
from tests.support.resources import reset_peak, status_bytes

def run(path):
    try:
        preprocess(Path(path).read_bytes(), Framing(), max_pixels=int(sys.argv[3]))
    except NoObjectFound:
        pass

configure_pillow()
run(sys.argv[1])  # a small image of the same type: loads the libraries
reset_peak("self")
before = status_bytes("self", "VmRSS")
run(sys.argv[2])
print(status_bytes("self", "VmHWM") - before)
"""


def _new(mode: str, **options: object) -> Callable[[tuple[int, int]], bytes]:
    kind = str(options.pop("kind", "PNG"))

    def draw(size: tuple[int, int]) -> bytes:
        image = Image.new(mode, size, 9)
        if mode in ("RGBA", "LA"):
            image.putalpha(77)
        return image_file(image, kind, **options)

    return draw


def _deep(color_type: int, samples: int, *extra: bytes) -> Callable[[tuple[int, int]], bytes]:
    """Return a drawing of a PNG of 16 bits."""
    return lambda size: png_file(*size, 16, color_type, bytes((2 * samples * size[0] + 1) * size[1]), *extra)


TURNED = Image.Exif()
TURNED[0x0112] = 6
FAST: dict[str, object] = {"compress_level": 1}
MODES = {
    "PNG 1": _new("1", **FAST, exif=TURNED),
    "PNG L": _new("L", **FAST, exif=TURNED),
    "PNG LA": _new("LA", **FAST, exif=TURNED),
    "PNG P": _new("P", **FAST, transparency=3, exif=TURNED),
    "PNG RGB": _new("RGB", **FAST, exif=TURNED),
    "PNG RGBA": _new("RGBA", **FAST, exif=TURNED),
    "PNG gray 16": _deep(0, 1),
    "PNG gray 16, transparent value": _deep(0, 1, png_chunk(b"tRNS", bytes(2))),
    "PNG gray and alpha 16": _deep(4, 2),
    "PNG RGB 16, transparent value": _deep(2, 3, png_chunk(b"tRNS", bytes(6))),
    "PNG RGBA 16": _deep(6, 4),
    "JPEG": _new("RGB", kind="JPEG", exif=TURNED),
    "JPEG progressive": _new("RGB", kind="JPEG", progressive=True, subsampling=0, exif=TURNED),
    "JPEG progressive CMYK": _new("CMYK", kind="JPEG", progressive=True, exif=TURNED),
    "WebP": _new("RGB", kind="WEBP", method=0, exif=TURNED),
    "WebP lossless": _new("RGBA", kind="WEBP", method=0, lossless=True, exif=TURNED),
    "AVIF": _new("RGB", kind="AVIF", speed=10, exif=TURNED),
}


def _check(folder: Path, draw: Callable[[tuple[int, int]], bytes], size: tuple[int, int], max_pixels: int) -> None:
    """Measure `preprocess` of a photo."""
    paths = [folder / "small", folder / "large"]
    for path, sides in zip(paths, ((64, 64), size), strict=True):
        path.write_bytes(draw(sides))
    command = [sys.executable, "-c", MEASURE, *map(str, paths), str(max_pixels)]
    result = subprocess.run(command, cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, capture_output=True, check=False)
    assert result.returncode == 0, result.stderr.decode()
    assert int(result.stdout) <= WORKING_BYTES * max_pixels + SLACK_BYTES


@pytest.mark.parametrize("name", MODES)
def test_decoding_at_the_pixel_limit_stays_within_the_stated_memory(tmp_path: Path, name: str) -> None:
    _check(tmp_path, MODES[name], QUARTER, DEFAULT_MAX_PIXELS // 4)


@pytest.mark.parametrize("name", ["PNG gray 16", "WebP lossless", "JPEG progressive CMYK"])
def test_decoding_at_the_default_pixel_limit_stays_within_the_stated_memory(tmp_path: Path, name: str) -> None:
    assert WHOLE[0] * WHOLE[1] == DEFAULT_MAX_PIXELS
    _check(tmp_path, MODES[name], WHOLE, DEFAULT_MAX_PIXELS)


@pytest.mark.parametrize("size", [(65_500, 120), (120, 65_500)], ids=str)
def test_decoding_of_a_long_jpeg_at_the_limit_stays_within_the_stated_memory(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    _check(tmp_path, MODES["JPEG progressive CMYK"], size, DEFAULT_MAX_PIXELS // 4)


def test_decoding_of_a_jpeg_of_48_megapixels_stays_within_the_stated_memory(tmp_path: Path) -> None:
    _check(tmp_path, MODES["JPEG progressive"], (8_000, 6_000), DEFAULT_MAX_PIXELS)


@pytest.mark.system
@pytest.mark.parametrize("threads", [1, 2, 4])
def test_matting_stays_within_the_stated_memory_and_returns_it(u2net: Path, threads: int) -> None:
    command = [sys.executable, "-c", MATTING, str(u2net), str(threads)]
    result = subprocess.run(command, cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, capture_output=True, check=False)
    assert result.returncode == 0, result.stderr.decode()
    peak, kept = map(int, result.stdout.split())
    assert peak <= MATTING_BYTES
    assert kept <= SLACK_BYTES
