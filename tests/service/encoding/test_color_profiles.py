"""ICC profiles: the same color in another profile gives the same pixels."""

import io
import struct
from functools import cache
from itertools import product

import numpy as np
import pytest
from PIL import Image, ImageCms

from service.encoding import color_profile
from service.encoding.containers.container import MAX_PROFILE_BYTES
from service.encoding.decode import decode
from service.encoding.framing import Framing, preprocess
from tests.support.photos import disc, image_file

KINDS = ["PNG", "JPEG", "WEBP", "AVIF"]
# Red, green and blue in XYZ at D50 (the profile's white), and the exponent of the curve.
DISPLAY_P3 = ([(0.51512, 0.2412, -0.00105), (0.29198, 0.69225, 0.04189), (0.1571, 0.06657, 0.78407)], 2.4)
ADOBE_RGB = ([(0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457)], 2.2)
D50 = (0.9642, 1.0, 0.8249)


def _fixed(value: float) -> bytes:
    return struct.pack(">i", round(value * 65_536))


def _xyz(values: tuple[float, ...]) -> bytes:
    return b"XYZ \0\0\0\0" + b"".join(map(_fixed, values))


def _gamma(exponent: float) -> bytes:
    return b"curv\0\0\0\0\0\0\0\1" + struct.pack(">H", round(exponent * 256)) + b"\0\0"


def _profile(space: bytes, tags: dict[bytes, bytes], device: bytes = b"mntr", connection: bytes = b"XYZ ") -> bytes:
    """Return an ICC profile of version 2 (ICC.1:2001-04)."""
    tags = {b"desc": b"desc" + bytes(4) + struct.pack(">I", 5) + b"test\0" + bytes(79), b"wtpt": _xyz(D50), **tags}
    at, table, data = 128 + 4 + 12 * len(tags), b"", b""
    for name, content in tags.items():
        table += name + struct.pack(">II", at + len(data), len(content))
        data += content + bytes(-len(content) % 4)
    head = (
        bytes(4) + b"lcms" + bytes.fromhex("02100000") + device + space + connection + bytes(12) + b"acsp" + bytes(28)
    )
    head += b"".join(map(_fixed, D50))
    body = head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + data
    return struct.pack(">I", len(body)) + body[4:]


def _rgb_profile(primaries: list[tuple[float, float, float]], exponent: float) -> bytes:
    curve = _gamma(exponent)
    colors = {name: _xyz(xyz) for name, xyz in zip((b"rXYZ", b"gXYZ", b"bXYZ"), primaries, strict=True)}
    return _profile(b"RGB ", {**colors, b"rTRC": curve, b"gTRC": curve, b"bTRC": curve})


PROFILES = {"Display P3": _rgb_profile(*DISPLAY_P3), "Adobe RGB": _rgb_profile(*ADOBE_RGB)}


def _cmyk_profile() -> bytes:
    """Return a profile in which cyan, magenta and yellow alone have a lightness of 50, and nothing has a hue."""
    nodes = [
        (255 if not any(inks) else 128 if sum(inks[:3]) == 1 and not inks[3] else 0, 128, 128)
        for inks in product((0, 1), repeat=4)
    ]  # L*, a*, b* as bytes; the last ink varies fastest
    ramp = bytes(range(256))
    matrix = b"".join(_fixed(value) for value in (1, 0, 0, 0, 1, 0, 0, 0, 1))
    table = b"mft1\0\0\0\0" + bytes([4, 3, 2, 0]) + matrix + 4 * ramp + b"".join(map(bytes, nodes)) + 3 * ramp
    return _profile(b"CMYK", {b"A2B0": table, b"A2B1": table}, b"prtr", b"Lab ")


GRAY = _profile(b"GRAY", {b"kTRC": _gamma(1.0)})
CMYK = _cmyk_profile()


@cache
def _srgb() -> bytes:
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def _in(profile: bytes, image: Image.Image) -> Image.Image:
    """Return the pixels that show an sRGB image in another profile."""
    converted = ImageCms.profileToProfile(
        image,
        ImageCms.ImageCmsProfile(io.BytesIO(_srgb())),
        ImageCms.ImageCmsProfile(io.BytesIO(profile)),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )
    assert converted is not None
    return converted


OPTIONS: dict[str, dict[str, object]] = {
    "PNG": {},
    "JPEG": {"quality": 98, "subsampling": 0},
    "WEBP": {"lossless": True},
    "AVIF": {"quality": 95},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PROFILES)
def test_decode_with_a_profile_gives_the_colors_in_srgb(kind: str, name: str) -> None:
    photo = disc("chocolate")
    file = image_file(_in(PROFILES[name], photo), kind, icc_profile=PROFILES[name], **OPTIONS[kind])
    center = np.asarray(decode(file), int)[50, 60]
    assert np.abs(center - photo.getpixel((60, 50))).max() <= (4 if kind in ("JPEG", "AVIF") else 2)
    assert np.abs(np.array(_in(PROFILES[name], photo).getpixel((60, 50)), int) - center).max() > 5


def test_decode_of_a_large_photo_with_a_profile_keeps_its_size_in_the_frame() -> None:
    photo = disc("chocolate").resize((2400, 1800))
    file = image_file(_in(PROFILES["Display P3"], photo), icc_profile=PROFILES["Display P3"], compress_level=1)
    framed, plain = (preprocess(each, Framing()) for each in (file, image_file(photo, compress_level=1)))
    assert (framed.width, framed.height) == (2400, 1800)
    np.testing.assert_allclose(framed.box, plain.box, atol=4)
    np.testing.assert_allclose(framed.tensor, plain.tensor, atol=0.02)


def test_decode_with_a_profile_keeps_transparency() -> None:
    photo = _in(PROFILES["Adobe RGB"], disc("chocolate"))
    alpha = Image.linear_gradient("L").resize(photo.size)
    photo.putalpha(alpha)
    image = decode(image_file(photo, icc_profile=PROFILES["Adobe RGB"]))
    np.testing.assert_array_equal(image.getchannel("A"), alpha)
    assert np.abs(np.asarray(image, int)[50, 60, :3] - (210, 105, 30)).max() <= 2


def test_decode_of_gray_with_a_profile_gives_srgb() -> None:
    image = decode(image_file(Image.new("L", (8, 8), 55), icc_profile=GRAY))  # 55 of 255 of the light: 128 in sRGB
    assert np.abs(np.asarray(image, int) - 128).max() <= 1


def test_decode_of_cmyk_with_a_profile_gives_srgb() -> None:
    file = image_file(Image.new("CMYK", (16, 16), (255, 0, 0, 0)), "JPEG", quality=98, icc_profile=CMYK)
    assert np.abs(np.asarray(decode(file), int) - 119).max() <= 3  # L* of 50


def test_decode_of_a_palette_with_a_profile_gives_srgb() -> None:
    palette = _in(PROFILES["Display P3"], disc("chocolate")).quantize(4)
    center = decode(image_file(palette, icc_profile=PROFILES["Display P3"])).getpixel((60, 50))
    assert np.abs(np.array(center, int) - (210, 105, 30)).max() <= 3


@pytest.mark.parametrize("kind", KINDS)
def test_decode_with_an_srgb_profile_gives_the_same_pixels(kind: str) -> None:
    photo = disc("chocolate")
    tagged, plain = (decode(image_file(photo, kind, **more)) for more in ({"icc_profile": _srgb()}, {}))
    np.testing.assert_array_equal(tagged, plain)


def _cut(profile: bytes) -> bytes:
    return profile[: len(profile) // 2]


BROKEN = {
    "empty": b"",
    "text": b"not a profile",
    "cut": _cut(PROFILES["Display P3"]),
    "too large": PROFILES["Display P3"] + bytes(MAX_PROFILE_BYTES),
    "for gray": GRAY,
    "a device link": PROFILES["Display P3"][:12] + b"link" + PROFILES["Display P3"][16:],
}


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
@pytest.mark.parametrize("name", BROKEN)
def test_decode_with_an_unusable_profile_gives_the_same_pixels(kind: str, name: str) -> None:
    photo = disc("chocolate")
    tagged, plain = (decode(image_file(photo, kind, **more)) for more in ({"icc_profile": BROKEN[name]}, {}))
    np.testing.assert_array_equal(tagged, plain)


@pytest.mark.parametrize("mode", ["RGB", "L", "CMYK"])
def test_to_srgb_with_damaged_profiles_never_raises(mode: str) -> None:
    dice = np.random.default_rng(0)
    image = Image.new(mode, (4, 4), 100 if mode == "L" else (100,) * len(mode))
    for profile in (*PROFILES.values(), GRAY, _srgb()):
        for _ in range(100):
            damaged = bytearray(profile)
            for at in dice.integers(0, len(damaged), 4):
                damaged[at] = dice.integers(256)
            assert color_profile.to_srgb(image, bytes(damaged)).size == image.size
