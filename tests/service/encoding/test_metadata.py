"""Metadata that is odd, damaged or large, in photos whose pixels are whole."""

import random
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from service.encoding.containers import exif
from service.encoding.containers.container import MAX_PARTS
from service.encoding.decode import decode
from service.errors import TooLarge
from tests.support.photos import disc, image_file, png_chunk, with_metadata

FUZZED = 2_000
KINDS = ["PNG", "JPEG", "WEBP"]
EXIF_NAMES = {"PNG": b"eXIf", "JPEG": b"\xe1Exif\0\0", "WEBP": b"EXIF"}
XMP_NAMES = {"JPEG": b"\xe1http://ns.adobe.com/xap/1.0/\0", "WEBP": b"XMP "}
XMP = b'<x:xmpmeta><rdf:Description tiff:Orientation="6"/></x:xmpmeta>'
PHOTO = disc("blue", (64, 48), (4, 4))
TALL = (48, 64)


def _field(tag: int, kind: int, count: int, value: bytes) -> bytes:
    return struct.pack("<HHI", tag, kind, count) + value.ljust(4, b"\0")


def _tiff(*fields: bytes) -> bytes:
    return b"II*\0" + struct.pack("<IH", 8, len(fields)) + b"".join(fields) + bytes(4)


ORIENTATION = _field(0x0112, 3, 1, b"\6")
ODD = {
    "XResolution is text": _tiff(ORIENTATION, _field(0x011A, 2, 3, b"72\0")),
    "GPS directory lies beyond the end": _tiff(ORIENTATION, _field(0x8825, 4, 1, b"\xff\xff\xff\x7f")),
    "value lies beyond the end": _tiff(_field(0x010F, 2, 4_000_000_000, b"\xff\xff\xff\xff"), ORIENTATION),
    "unknown type": _tiff(_field(0x0100, 99, 1, b""), ORIENTATION),
    "orientation is a long": _tiff(_field(0x0112, 4, 1, b"\6")),
    "more fields announced than there are": b"II*\0\x08\0\0\0\xff\xff" + ORIENTATION,
    "no magic number": b"II\0\0" + _tiff(ORIENTATION)[4:],
}
UNREADABLE = {
    "empty": b"",
    "no TIFF header": b"no header at all",
    "directory lies beyond the end": b"II*\0\xff\xff\xff\xff",
    "directory is cut": _tiff(ORIENTATION)[:14],
    "orientation 0": _tiff(_field(0x0112, 3, 1, b"\0")),
    "orientation 9": _tiff(_field(0x0112, 3, 1, b"\x09")),
    "orientation is text": _tiff(_field(0x0112, 2, 2, b"6\0")),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ODD)
def test_decode_with_odd_exif_turns_the_image_upright(kind: str, name: str) -> None:
    assert decode(with_metadata(image_file(PHOTO, kind), EXIF_NAMES[kind], ODD[name])).size == TALL


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", UNREADABLE)
def test_decode_with_unreadable_exif_leaves_the_image_as_it_is(kind: str, name: str) -> None:
    file = image_file(PHOTO, kind)
    damaged = decode(with_metadata(file, EXIF_NAMES[kind], UNREADABLE[name]))
    np.testing.assert_array_equal(damaged, decode(file))


def test_decode_with_fuzzed_exif_reads_every_image() -> None:
    """Damage to 2,000 EXIFs of turned photos: no pixel is lost, and no exception leaves `decode`."""
    full = Image.Exif()
    full[0x0112], full[0x010F], full[0x011A] = 6, "A maker", 72.0
    full.get_ifd(0x8825)[2] = (52.0, 30.0, 1.0)
    full.get_ifd(0x8769)[0x9003] = "2026:01:01 00:00:00"
    sound, dice, turned = full.tobytes(), random.Random(0), 0
    files = {kind: image_file(PHOTO, kind) for kind in KINDS}
    for number in range(FUZZED):
        kind, damaged = KINDS[number % 3], bytearray(sound[6:])
        for _ in range(dice.choice((1, 1, 2, 4, 16))):
            damaged[dice.randrange(len(damaged))] = dice.randrange(256)
        size = decode(with_metadata(files[kind], EXIF_NAMES[kind], bytes(damaged))).size
        assert size in (PHOTO.size, TALL)
        turned += size == TALL
    assert turned > FUZZED / 2


def test_orientation_of_exif_wins_over_xmp() -> None:
    assert exif.orientation_of(_tiff(_field(0x0112, 3, 1, b"\3")), XMP) == 3
    assert exif.orientation_of(b"", XMP) == 6
    assert exif.orientation_of(b"", b"<tiff:Orientation>8</tiff:Orientation>") == 8


@pytest.mark.parametrize("kind", XMP_NAMES)
def test_decode_with_xmp_orientation_turns_the_image_upright(kind: str) -> None:
    assert decode(with_metadata(image_file(PHOTO, kind), XMP_NAMES[kind], XMP)).size == TALL


@pytest.mark.parametrize(
    ("name", "data"),
    [
        (b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + XMP),
        (b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0" + zlib.compress(XMP)),
        (b"zTXt", b"Raw profile type exif\0\0" + zlib.compress(b"\nexif\n  40\n" + _tiff(ORIENTATION).hex().encode())),
    ],
    ids=["XMP", "packed XMP", "ImageMagick's EXIF"],
)
def test_decode_of_a_png_finds_an_orientation_in_text(name: bytes, data: bytes) -> None:
    assert decode(with_metadata(image_file(PHOTO), name, data)).size == TALL


LARGE = zlib.compress(bytes(1_500_000))


@pytest.mark.parametrize(
    ("kind", "name", "data"),
    [
        ("PNG", b"zTXt", b"Comment\0\0" + LARGE),
        ("PNG", b"zTXt", b"Comment\0\0not packed"),
        ("PNG", b"zTXt", b"no end of the keyword"),
        ("PNG", b"iTXt", b"Comment\0\1\0\0\0" + LARGE),
        ("PNG", b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0" + LARGE),
        ("PNG", b"iTXt", b"XML:com.adobe.xmp\0\1"),
        ("PNG", b"tEXt", b"\xff" * 3_000_000),
        ("PNG", b"zTXt", b"Raw profile type exif\0\0" + zlib.compress(b"\nexif\n  8\nzz")),
        ("PNG", b"iCCP", b"name\0\0" + zlib.compress(bytes(9_000_000))),
        ("PNG", b"iCCP", b"name\0\7" + LARGE),
        ("PNG", b"iCCP", b"name"),
        ("PNG", b"iCCP", b""),
        ("PNG", b"pHYs", b"\1"),
        ("PNG", b"gAMA", b""),
        ("PNG", b"acTL", b""),
        ("PNG", b"fcTL", b"\0\0\0\7"),
        ("PNG", b"sBIT", bytes(99)),
        ("JPEG", b"\xe0JFIF\0", b""),
        ("JPEG", b"\xe1Exif\0\0", bytes(65_000)),
        ("JPEG", b"\xe2ICC_PROFILE\0", b""),
        ("JPEG", b"\xe2ICC_PROFILE\0", b"\1\2rest"),
        ("JPEG", b"\xe2ICC_PROFILE\0", b"\0\0"),
        ("JPEG", b"\xe2MPF\0", b"MM\0*\xff\xff\xff\xff"),
        ("JPEG", b"\xedPhotoshop 3.0\0", b"8BIM\3\xed\xff"),
        ("JPEG", b"\xfe", b"\xff" * 60_000),
        ("WEBP", b"EXIF", bytes(2_000_000)),
        ("WEBP", b"XMP ", b"\xff" * 2_000_000),
        ("WEBP", b"ICCP", b"no profile"),
        ("WEBP", b"ICCP", bytes(9_000_000)),
    ],
)
def test_decode_with_broken_or_large_metadata_gives_the_same_pixels(kind: str, name: bytes, data: bytes) -> None:
    file = image_file(PHOTO, kind)
    np.testing.assert_array_equal(decode(with_metadata(file, name, data)), decode(file))


def test_decode_with_a_wrong_checksum_of_metadata_gives_the_same_pixels() -> None:
    file = image_file(PHOTO)
    damaged = png_chunk(b"tEXt", b"Comment\0text")[:-1] + b"?"
    np.testing.assert_array_equal(decode(file[:33] + damaged + file[33:]), decode(file))


@pytest.mark.parametrize("cut", [12, 8, 4, 1])
def test_decode_of_a_png_without_its_end_gives_the_same_pixels(cut: int) -> None:
    file = image_file(PHOTO)
    np.testing.assert_array_equal(decode(file[:-cut]), decode(file))


def test_decode_of_too_many_chunks_or_segments_raises_too_large() -> None:
    png, jpeg, webp = (image_file(PHOTO, kind) for kind in KINDS)
    files = [
        png[:33] + png_chunk(b"tEXt", b"a\0b") * MAX_PARTS + png[33:],
        png[:33] + png_chunk(b"IDAT", b"") * MAX_PARTS + png[33:],
        jpeg[:2] + b"\xff\xfe\0\2" * MAX_PARTS + jpeg[2:],
        with_metadata(webp, b"XMP ", b"") + b"ABCD\0\0\0\0" * MAX_PARTS,
    ]
    files[3] = files[3][:4] + struct.pack("<I", len(files[3]) - 8) + files[3][8:]
    for file in files:
        with pytest.raises(TooLarge, match=f"more than {MAX_PARTS} "):
            decode(file)
