"""Sweet Home 3D's furniture libraries: 820 textured OBJ models under CC-BY 3.0 and CC0.

They come from Debian's package `sweethome3d-furniture`, which is downloaded and unpacked, not installed. Its five
`.sh3f` files are zips with a catalog (`PluginFurnitureCatalog.properties`) and the models.
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
CATALOG: Final = "PluginFurnitureCatalog.properties"
_ENTRY: Final = re.compile(r"(\w+)#(\d+)\s*[=:]\s*(.*)")
_ESCAPE: Final = re.compile(r"\\u([0-9a-fA-F]{4})|\\(.)")


def sh3f_files(source: Path | None, work: Path) -> list[Path]:
    """Return the `.sh3f` files of a folder, of a `.deb`, or (source None) of Debian's package.

    Parameters
    ----------
    source : a folder with `.sh3f` files, one `.sh3f`, or a downloaded `.deb`.
    work : folder in which the package is downloaded and unpacked.

    Raises
    ------
    FileNotFoundError : there is no `.sh3f` file, or Debian's package tools are missing.
    """
    if source is None or source.suffix == ".deb":
        deb = source or download(PACKAGE, work)
        source = work / deb.stem
        unpack(deb, source)
    libraries = sorted(source.rglob("*.sh3f")) if source.is_dir() else [source]
    if not libraries or not all(path.is_file() for path in libraries):
        raise FileNotFoundError(f"no .sh3f file in {source}: pass a folder with .sh3f files, or the .deb")
    return libraries


def frozen_split() -> dict[str, Split]:
    """Return id -> split of the objects of the first build, without duplicates.

    All figures and shipped models of this project use this split, whatever a later build contains.
    """
    ids: dict[Split, list[str]] = json.loads(FROZEN.read_text(encoding="utf-8"))
    return {id_: split for split, of_split in ids.items() for id_ in of_split}


def sh3f_records(sh3f: Path, work: Path) -> Iterator[MeshRecord]:
    """Unpack one library below `work` and yield its models with the catalog's metadata."""
    root = work / sh3f.stem
    with zipfile.ZipFile(sh3f) as library:
        if not (root / ".complete").exists():
            library.extractall(root)
            (root / ".complete").touch()
        general, entries = parse_catalog(library.read(CATALOG).decode("latin-1"))
    license_ = " ".join(general.get("license", "unknown").split())
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
            license=license_,
            rotation=tuple(float(number) for number in rotation.split()),
        )


def parse_catalog(text: str) -> tuple[dict[str, str], list[dict[str, str]]]:
    """Parse a Java properties file with numbered keys; return the library's fields, and the models in order."""
    general: dict[str, str] = {}
    entries: dict[int, dict[str, str]] = {}
    for line in text.splitlines():
        if line.startswith(("#", "!")):
            continue
        value = _ESCAPE.sub(lambda match: chr(int(match[1], 16)) if match[1] else match[2], line)
        if match := _ENTRY.match(value):
            entries.setdefault(int(match[2]), {})[match[1]] = match[3].strip()
        elif "=" in value:
            key, _, rest = value.partition("=")
            general[key.strip()] = rest.strip()
    return general, [entries[number] for number in sorted(entries) if "model" in entries[number]]
