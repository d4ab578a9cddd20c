"""Boxes of the ISO base media file format (ISO 14496-12), and the items that AVIF and HEIC keep in them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from service.encoding.containers.container import check_count
from service.errors import CorruptImage

MAX_ITEMS: Final = 4_096  # a picture of 64 MP in tiles of 512 x 512 has 256
TABLES: Final = frozenset({b"iref", b"ipma", b"grpl"})  # libavif's time grows with the square of their entries
MAX_TABLE_BYTES: Final = 65_536  # of these together: 4,096 items take some 40,000


@dataclass(frozen=True)
class Item:
    """One item of a file: its type, the offset of that type in the file, and its data."""

    kind: bytes
    kind_at: int
    data: bytes


class Reader:
    """A cursor over bytes; reading beyond the end raises CorruptImage."""

    def __init__(self, data: bytes, at: int, end: int) -> None:
        self.data, self.at, self.end = data, at, min(end, len(data))

    def take(self, size: int) -> bytes:
        """Return the next bytes."""
        self.at += size
        if self.at > self.end:
            raise CorruptImage("the image is truncated or corrupt: a box ends too early", field="image")
        return self.data[self.at - size : self.at]

    def number(self, size: int) -> int:
        """Return the next big-endian number of `size` bytes; 0 for no bytes."""
        return int.from_bytes(self.take(size), "big")

    def boxes(self) -> Iterator[tuple[bytes, "Reader"]]:
        """Yield the type and the content of each box from here on."""
        count = 0
        while self.at + 8 <= self.end:
            check_count(count := count + 1, "boxes")
            start, size, kind = self.at, self.number(4), self.take(4)
            size = self.number(8) if size == 1 else size or self.end - start
            if size < self.at - start:
                raise CorruptImage("the image is truncated or corrupt: a box is too small", field="image")
            yield kind, Reader(self.data, self.at, start + size)
            self.at = start + size


def brands(data: bytes) -> frozenset[bytes]:
    """Return the brands that a file claims in its first box; none if it is another type of file."""
    if data[4:8] != b"ftyp":
        return frozenset()
    listed = data[16 : min(int.from_bytes(data[:4], "big"), 1024)]
    return frozenset((data[8:12], *(listed[at : at + 4] for at in range(0, len(listed), 4))))


def items(data: bytes) -> list[Item]:
    """Return the items of a file. Raises CorruptImage, TooLarge."""
    meta = next((box for kind, box in Reader(data, 0, len(data)).boxes() if kind == b"meta"), None)
    if meta is None:
        return []
    meta.take(4)  # version and flags
    listed = list(meta.boxes())
    _check_tables(listed)
    children = dict(listed)
    kinds = dict(_kinds(children[b"iinf"])) if b"iinf" in children else {}
    store = children.get(b"idat")
    extents = dict(_extents(children[b"iloc"], store.at if store else 0)) if b"iloc" in children else {}
    if sum(max(0, min(end, len(data)) - begin) for ranges in extents.values() for begin, end in ranges) > len(data):
        raise CorruptImage("the image is truncated or corrupt: its items overlap", field="image")
    return [
        Item(kind, at, b"".join(data[begin:end] for begin, end in extents.get(number, [])))
        for number, (kind, at) in kinds.items()
    ]


def _check_tables(listed: list[tuple[bytes, Reader]]) -> None:
    """Raise TooLarge if the tables that relate items to each other are longer than those of MAX_ITEMS items."""
    inner = [each for kind, box in listed if kind == b"iprp" for each in Reader(box.data, box.at, box.end).boxes()]
    check_count(
        sum(box.end - box.at for kind, box in (*listed, *inner) if kind in TABLES),
        "bytes that relate its items",
        MAX_TABLE_BYTES,
    )


def _kinds(box: Reader) -> Iterator[tuple[int, tuple[bytes, int]]]:
    """Yield the number of each item, with its type and the offset of that."""
    version = box.number(4) >> 24
    check_count(box.number(2 if version == 0 else 4), "items", MAX_ITEMS)
    for count, (_, entry) in enumerate(box.boxes(), 1):
        check_count(count, "items", MAX_ITEMS)
        version = entry.number(4) >> 24
        if version >= 2:
            number, _ = entry.number(2 if version == 2 else 4), entry.take(2)
            yield number, (entry.take(4), entry.at - 4)


def _extents(box: Reader, store: int) -> Iterator[tuple[int, list[tuple[int, int]]]]:
    """Yield the number of each item, with the ranges of its data; `store` is where the box `idat` begins."""
    version, sizes = box.number(4) >> 24, box.number(2)
    offset_size, length_size, base_size, index_size = (sizes >> shift & 15 for shift in (12, 8, 4, 0))
    wide = 2 if version < 2 else 4
    count, total = box.number(wide), 0
    check_count(count, "items", MAX_ITEMS)
    for _ in range(count):
        number, method = box.number(wide), box.number(2) & 15 if version else 0
        box.take(2)  # in which file: this one
        base, ranges = box.number(base_size) + (store if method == 1 else 0), []
        parts = box.number(2)
        check_count(total := total + parts, "parts of items")
        for _ in range(parts):
            box.take(index_size if version else 0)
            begin, length = base + box.number(offset_size), box.number(length_size)
            ranges.append((begin, begin + length if length else len(box.data)))
        yield number, ranges
