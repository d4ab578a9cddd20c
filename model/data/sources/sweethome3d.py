"""Sweet Home 3D's furniture libraries: 820 textured OBJ models under CC-BY 3.0 and CC0.

They come from Debian's package `sweethome3d-furniture`, whose five `.sh3f` files are zips with a
catalogue (`PluginFurnitureCatalog.properties`) and the models. Nothing is installed: the package is
downloaded and unpacked.
"""

import json
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from model.data.manifest import Split
from model.data.sources.debian import download, unpack
from model.data.sources.meshes import MeshRecord

PACKAGE: Final = "sweethome3d-furniture"
FROZEN: Final = Path(__file__).with_name("sweethome3d-split.json")
CATALOGUE: Final = "PluginFurnitureCatalog.properties"
_ENTRY: Final = re.compile(r"(\w+)#(\d+)\s*[=:]\s*(.*)")
_ESCAPE: Final = re.compile(r"\\u([0-9a-fA-F]{4})|\\(.)")


def sh3f_files(source: Path | None, work: Path) -> list[Path]:
    """The `.sh3f` files of a folder, of a `.deb`, or (source None) of Debian's package.

    Parameters
    ----------
    source : a folder that holds `.sh3f` files, one `.sh3f`, or a downloaded `.deb`.
    work : where the package is downloaded and unpacked.

    Raises
    ------
    FileNotFoundError : there is none, or the tools to get them are missing.
    """
    if source is None or source.suffix == ".deb":
        deb = source or download(PACKAGE, work)
        source = work / deb.stem
        unpack(deb, source)
    found = sorted(source.rglob("*.sh3f")) if source.is_dir() else [source]
    if not found or not all(path.is_file() for path in found):
        raise FileNotFoundError(f"no .sh3f file in {source}")
    return found


def frozen_split() -> dict[str, Split]:
    """id -> split of the objects that are no duplicates, as the first build had them: what all figures and shipped
    models of this project are of, whatever a later build finds."""
    ids: dict[Split, list[str]] = json.loads(FROZEN.read_text(encoding="utf-8"))
    return {id_: split for split, of_split in ids.items() for id_ in of_split}


def sh3f_records(sh3f: Path, work: Path) -> Iterator[MeshRecord]:
    """Unpack one library below `work` and yield its models with the catalogue's metadata."""
    root = work / sh3f.stem
    with zipfile.ZipFile(sh3f) as library:
        if not (root / ".complete").exists():
            library.extractall(root)
            (root / ".complete").touch()
        general, entries = parse_catalogue(library.read(CATALOGUE).decode("latin-1"))
    licence = " ".join(general.get("license", "unknown").split())
    for entry in entries:
        model = entry["model"].lstrip("/")
        rotation = entry.get("modelRotation", "1 0 0 0 1 0 0 0 1")
        yield MeshRecord(
            id=f"{sh3f.stem}/{Path(model).stem}",
            path=root / model,
            source=sh3f.stem,
            name=entry["name"],
            category=entry.get("category", "unknown"),
            creator=entry.get("creator", general.get("name", "unknown")),
            licence=licence,
            rotation=tuple(float(number) for number in rotation.split()),
        )


def parse_catalogue(text: str) -> tuple[dict[str, str], list[dict[str, str]]]:
    """A Java properties file with numbered keys -> the library's fields, the models in order."""
    general: dict[str, str] = {}
    entries: dict[int, dict[str, str]] = {}
    for line in text.splitlines():
        if line.startswith(("#", "!")):
            continue
        value = _ESCAPE.sub(lambda hit: chr(int(hit[1], 16)) if hit[1] else hit[2], line)
        if match := _ENTRY.match(value):
            entries.setdefault(int(match[2]), {})[match[1]] = match[3].strip()
        elif "=" in value:
            key, _, rest = value.partition("=")
            general[key.strip()] = rest.strip()
    return general, [entries[number] for number in sorted(entries) if "model" in entries[number]]
