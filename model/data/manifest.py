"""The manifest: which objects the data set holds, where each comes from, and in which split it is."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from service.files import whole_file

Split = Literal["train", "val", "test"]
SPLITS: Final[tuple[Split, ...]] = ("train", "val", "test")
SHARES: Final = (0.8, 0.1, 0.1)
SIZE: Final = 128  # pixels a side of the views that are rendered
VARIANTS: Final = "variants"  # folder of what `hof-model data vary` writes, in the data set's folder
MADE: Final = "made"  # of what `hof-model data make` writes


@dataclass(frozen=True)
class Entry:
    """One object. `mesh_sha256` tells which file the mesh was; `file` is relative to the data set's folder."""

    id: str
    name: str
    source: str
    category: str
    creator: str
    licence: str
    mesh_sha256: str
    file: str
    split: Split


@dataclass(frozen=True)
class Manifest:
    """A data set: its objects by split order, what was left out and why, and the seed of it all."""

    seed: int
    entries: tuple[Entry, ...]
    duplicates: dict[str, str]  # id left out -> id kept
    failures: dict[str, str]  # id -> why its mesh could not be used

    def of(self, split: Split) -> Iterator[Entry]:
        """The split's objects in manifest order."""
        return (entry for entry in self.entries if entry.split == split)

    def write(self, path: Path) -> None:
        """Write as JSON, whole or not at all."""
        with whole_file(path) as file:
            file.write((json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n").encode())

    @classmethod
    def read(cls, folder: Path) -> "Manifest":
        """The manifest of a data set's folder.

        Raises
        ------
        FileNotFoundError : `hof-model data build` has not finished there.
        """
        path = folder / "manifest.json"
        if not path.is_file():
            raise FileNotFoundError(f"{path} is missing: run `hof-model data build --out {folder}` first")
        fields = json.loads(path.read_text(encoding="utf-8"))
        return cls(**{**fields, "entries": tuple(Entry(**entry) for entry in fields["entries"])})


def variant_file(folder: Path, entry: Entry, number: int) -> Path:
    """Where variant `number` of an object lies or will lie; 0 is the object itself under free cameras."""
    return folder / VARIANTS / f"{Path(entry.file).stem}__{number}.npz"


def variant_files(folder: Path, entry: Entry) -> list[Path]:
    """The variants of an object that are there, in order of their numbers, the first of them 0.

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


def made_files(folder: Path) -> list[Path]:
    """The made furniture in a data set's folder, in order of its numbers.

    Raises
    ------
    FileNotFoundError : there is none.
    """
    files = sorted((folder / MADE).glob("*.npz"))
    if not files:
        raise FileNotFoundError(f"{folder} holds no made furniture: run `hof-model data make --data {folder}` first")
    return files


def assign_splits(ids: list[str], seed: int, known: Mapping[str, Split] | None = None) -> dict[str, Split]:
    """The splits of ids: those that are `known` as they are, the others 80/10/10 at random, by seed, in whatever order
    `ids` come."""
    splits = {id_: split for id_, split in (known or {}).items() if id_ in set(ids)}
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
