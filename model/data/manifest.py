"""The manifest of a data set: its objects, their files, sources and splits."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from service.files import whole_file

Split = Literal["train", "val", "test"]
SPLITS: Final[tuple[Split, ...]] = ("train", "val", "test")
SHARES: Final = (0.8, 0.1, 0.1)
SIZE: Final = 192  # pixels per side of a rendered view
SURFACE_POINTS: Final = 10_000  # of an object
OBJECTS: Final = "objects"  # folder of the objects' files, in the data set's folder
VARIANTS: Final = "variants"  # folder that `hof-model data vary` writes, in the data set's folder
PIECES: Final = "made"  # folder that `hof-model data make` writes
TEXTURES: Final = "textures"  # folder that `hof-model data textures` writes
COLORS: Final = "colours"  # name of the points' colors in an object's file
_MAX_STEM: Final = 200  # bytes of a file's name; the file system's limit is 255, with variants and temporary files
_DIGEST: Final = 16  # hexadecimal digits that keep cut names apart
_KEYS: Final = {"license": "licence"}  # field -> key in manifest.json, where they differ
_OPTIONAL: Final = {"page": "", "rotation": None}  # field -> value for which manifest.json has no key


@dataclass(frozen=True)
class Entry:
    """An object of the data set: its arrays, its mesh, its source and license, and its split.

    mesh_sha256 : identifies its mesh file.
    file : its arrays, relative to the data set's folder.
    page : address of its page, for NOTICE.
    rotation : row-major 3x3 matrix from the mesh file's frame to the object frame; None for none.
    """

    id: str
    name: str
    source: str
    category: str
    creator: str
    license: str
    mesh_sha256: str
    file: str
    split: Split
    page: str = ""
    rotation: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Manifest:
    """A data set: its objects, the meshes left out and why, what others lack, and its seed."""

    seed: int
    entries: tuple[Entry, ...]
    duplicates: dict[str, str]  # id left out -> id kept
    failures: dict[str, str]  # id -> why its mesh could not be used
    losses: dict[str, str] = field(default_factory=dict)  # id -> textures and materials that could not be used

    def of(self, split: Split) -> Iterator[Entry]:
        """Return the split's objects in manifest order."""
        return (entry for entry in self.entries if entry.split == split)

    def write(self, path: Path) -> None:
        """Write as JSON, whole or not at all."""
        fields = asdict(self)
        fields["entries"] = [
            {_KEYS.get(name, name): value for name, value in entry.items() if value != _OPTIONAL.get(name, ...)}
            for entry in fields["entries"]
        ]
        if not self.losses:
            del fields["losses"]
        with whole_file(path) as file:
            file.write((json.dumps(fields, indent=1, ensure_ascii=False) + "\n").encode())

    @classmethod
    def read(cls, folder: Path) -> "Manifest":
        """Read the manifest of a data set's folder.

        Raises
        ------
        FileNotFoundError : `hof-model data build` has not finished there.
        """
        path = folder / "manifest.json"
        if not path.is_file():
            raise FileNotFoundError(f"{path} is missing: run `hof-model data build --out {folder}` first")
        fields = json.loads(path.read_text(encoding="utf-8"))
        names = {key: name for name, key in _KEYS.items()}
        entries = [{names.get(key, key): value for key, value in entry.items()} for entry in fields["entries"]]
        for entry in entries:
            if "rotation" in entry:
                entry["rotation"] = tuple(entry["rotation"])
        return cls(**{**fields, "entries": tuple(Entry(**entry) for entry in entries)})


def variant_file(folder: Path, entry: Entry, number: int) -> Path:
    """Return the path of variant `number` of an object; 0 is the object itself under free cameras."""
    return folder / VARIANTS / f"{Path(entry.file).stem}__{number}.npz"


def variant_files(folder: Path, entry: Entry) -> list[Path]:
    """Return the existing variants of an object, numbered from 0, in order.

    Raises
    ------
    FileNotFoundError : variant 0 is missing.
    """
    first = variant_file(folder, entry, 0)
    if not first.is_file():
        raise FileNotFoundError(f"{first} is missing: run `hof-model data vary --data {folder}` first")
    files = [first]
    while (following := variant_file(folder, entry, len(files))).is_file():
        files.append(following)
    return files


def piece_files(folder: Path) -> list[Path]:
    """Return the procedural pieces in a data set's folder, in order of their numbers.

    Raises
    ------
    FileNotFoundError : there is none.
    """
    files = sorted((folder / PIECES).glob("*.npz"))
    if not files:
        raise FileNotFoundError(f"{folder} holds no procedural pieces: run `hof-model data make --data {folder}` first")
    return files


def texture_files(folder: Path) -> list[Path]:
    """Return the textures in a data set's folder, sorted; none before `hof-model data textures`."""
    return sorted((folder / TEXTURES).glob("*.jpg"))


def piece_entries(folder: Path) -> tuple[Entry, ...]:
    """Return the entries of the pieces that `hof-model data make --meshes` made; pieces made by rule have none."""
    pieces = folder / PIECES
    return Manifest.read(pieces).entries if (pieces / "manifest.json").is_file() else ()


def assign_splits(ids: list[str], seed: int, fixed: Mapping[str, Split] | None = None) -> dict[str, Split]:
    """Assign splits to ids: those of `fixed` stay, the others get 80/10/10 at random by seed.

    The order of `ids` does not matter.
    """
    splits = {id_: split for id_, split in (fixed or {}).items() if id_ in set(ids)}
    fresh = sorted(set(ids) - set(splits))
    shuffled: npt.NDArray[np.str_] = np.random.default_rng(seed).permutation(fresh)
    held = {split: round(share * len(fresh)) for split, share in zip(SPLITS, SHARES, strict=True)}
    for position, id_ in enumerate(shuffled.tolist()):
        held_out: Split = "train"
        if position < held["val"]:
            held_out = "val"
        elif position < held["val"] + held["test"]:
            held_out = "test"
        splits[id_] = held_out
    return splits


def object_file(id_: str) -> str:
    """Return the path of an object's arrays, relative to the data set's folder; long names are cut."""
    stem = id_.replace("/", "__")
    encoded = stem.encode()
    if len(encoded) > _MAX_STEM:
        start = encoded[: _MAX_STEM - _DIGEST - 1].decode(errors="ignore")
        stem = f"{start}-{hashlib.sha256(encoded).hexdigest()[:_DIGEST]}"
    return f"{OBJECTS}/{stem}.npz"
