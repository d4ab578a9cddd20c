"""Materials and textures beside a mesh, found by name where the mesh names them wrongly."""

import io
import re
import struct
import unicodedata
import zlib
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath
from typing import Final
from urllib.parse import unquote

from PIL import Image

IMAGES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".gif", ".webp", ".dds")
SEARCHED: Final = (*IMAGES, ".mtl")  # a buffer of the same name elsewhere belongs to another mesh
_OPTION: Final = re.compile(  # of a texture in an MTL file
    r"-(?:(?:blend[uv]|cc|clamp|imfchan|texres|type|bm|boost)\s+\S+|mm\s+\S+\s+\S+|(?P<key>[ost])(?P<numbers>(?:\s+[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?){1,3}))\s+",
    re.IGNORECASE,
)
_BROKEN: Final = (
    OSError,
    SyntaxError,
    ValueError,
    IndexError,
    TypeError,
    EOFError,
    struct.error,
    zlib.error,
    Image.DecompressionBombError,
)


class Assets:
    """Reads the files that a mesh names, as a resolver of trimesh.

    A name may have backslashes, a drive, percent signs, other case, or the options of an MTL file. A texture or
    material that is not at its place is searched by name: below the mesh's folder, then below the folders above it up
    to `root`, if one file there fits best. Nothing outside `root` is read.

    losses : a sentence for each file that could not be used, in order.
    """

    def __init__(self, mesh: Path, root: Path) -> None:
        self._folder = mesh.parent.resolve()
        self._root = root.resolve() if self._folder.is_relative_to(root.resolve()) else self._folder
        self.losses: list[str] = []

    def __getitem__(self, name: str) -> bytes:
        """Return the file's content; see `get`."""
        return self.get(name)

    def get(self, name: str) -> bytes:
        """Return a file's content; that of a material file as UTF-8.

        Raises
        ------
        FileNotFoundError : there is no such file, or it is no image that can be read. `losses` has it, too.
        """
        path = self.find(name)
        if path is None:
            raise self._loss(f"{split_options(name)[0]} is missing")
        data = path.read_bytes()
        if path.suffix.lower() == ".mtl":
            return decode(data).encode()
        if path.suffix.lower() in IMAGES:
            try:
                with Image.open(io.BytesIO(data)) as image:
                    image.load()
            except _BROKEN as error:
                raise self._loss(f"{path.name} cannot be read") from error
        return data

    def find(self, name: str) -> Path | None:
        """Return the file that a mesh means by `name`, or None."""
        plain = split_options(name)[0]
        spellings = [name.strip(), plain, unquote(plain)]
        for spelling in spellings:
            for path in (self._folder / spelling, self._folder.joinpath(*_parts(spelling))):
                if self._is_readable(path):
                    return path
        for spelling in spellings:
            parts = tuple(_fold(part) for part in _parts(spelling))
            if parts and (match := self._search(parts)):
                return match
        return None

    def _search(self, parts: tuple[str, ...]) -> Path | None:
        """Return the file in the nearest folder whose path ends most like `parts`, case aside."""
        for folder in self._folders():
            ranks: dict[tuple[int, int], list[Path]] = {}
            for path in folder.rglob("*"):
                if _fold(path.name) == parts[-1] and self._is_readable(path):
                    place = tuple(_fold(part) for part in path.relative_to(folder).parts)
                    ranks.setdefault((-_common_end(place, parts), len(place)), []).append(path)
            if not Path(parts[-1]).suffix.endswith(SEARCHED):
                exact = ranks.get((-len(parts), len(parts)), [])
                return min(exact, default=None)
            if ranks:
                best = sorted(ranks[min(ranks)])
                return best[0] if folder == self._folder or len(best) == 1 else None
        return None

    def _folders(self) -> Iterator[Path]:
        yield self._folder
        for folder in self._folder.parents:
            if folder.is_relative_to(self._root):
                yield folder

    def _is_readable(self, path: Path) -> bool:
        try:
            return path.resolve().is_relative_to(self._root) and path.is_file()
        except (OSError, ValueError):  # a name that no file can have
            return False

    def _loss(self, loss: str) -> FileNotFoundError:
        if loss not in self.losses:
            self.losses.append(loss)
        return FileNotFoundError(loss)


def split_options(name: str) -> tuple[str, dict[str, tuple[float, ...]]]:
    """Return an MTL texture's file name without quotes and options, and the options `s` (scale) and `o` (offset)."""
    rest = name.strip()
    options = {}
    while match := _OPTION.match(rest):
        if match["key"]:
            options[match["key"].lower()] = tuple(float(number) for number in match["numbers"].split())
        rest = rest[match.end() :].strip()
    return rest.strip("\"'"), options


def decode(data: bytes) -> str:
    """Return a text file's content: UTF-8, or else Latin-1."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _parts(name: str) -> list[str]:
    """Return a path's parts, whatever its slashes, without drive, root and steps up."""
    path = PureWindowsPath(name)
    return [part for part in path.parts if part not in (path.anchor, "..", ".")]


def _fold(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


def _common_end(a: tuple[str, ...], b: tuple[str, ...]) -> int:
    length = 0
    while length < min(len(a), len(b)) and a[-1 - length] == b[-1 - length]:
        length += 1
    return length
