"""Checkpoints as one file, or in parts small enough for a channel that refuses large files.

In parts, `last.pt` becomes `last.pt.DIGEST.00`, `last.pt.DIGEST.01`, ... and `last.pt.parts`, JSON with their names and
the SHA-256 of the whole. A new checkpoint's parts are written beside the old ones, which go once the new are complete.
"""

import hashlib
import io
import json
from pathlib import Path
from typing import Any, Final

import torch

from service.files import whole_file

PART_BYTES: Final = 14_000_000
INDEX: Final = ".parts"  # suffix


def save_checkpoint(saved: dict[str, Any], path: Path, in_parts: bool = False) -> None:
    """Write a checkpoint, whole or in parts; the files of an earlier one in the other form are removed."""
    earlier = [path.with_name(name) for name in _index(path)["parts"]] if _index_path(path).exists() else []
    written = _save_parts(saved, path) if in_parts else []
    if in_parts:
        path.unlink(missing_ok=True)
    else:
        with whole_file(path) as file:
            torch.save(saved, file)
        _index_path(path).unlink(missing_ok=True)
    for part in set(earlier) - set(written):
        part.unlink(missing_ok=True)


def load_checkpoint(path: Path, device: torch.device | str = "cpu") -> dict[str, Any]:
    """Read a checkpoint that lies there whole or in parts.

    Raises
    ------
    FileNotFoundError : there is neither, or a part is missing.
    ValueError : the parts are not those of one checkpoint.
    """
    if path.exists() or not _index_path(path).exists():
        with path.open("rb") as file:
            whole: dict[str, Any] = torch.load(file, weights_only=True, map_location=device)
        return whole
    index = _index(path)
    data = b"".join(path.with_name(name).read_bytes() for name in index["parts"])
    if hashlib.sha256(data).hexdigest() != index["sha256"]:
        raise ValueError(f"the parts of {path} do not fit together: copy them again, all of one checkpoint")
    joined: dict[str, Any] = torch.load(io.BytesIO(data), weights_only=True, map_location=device)
    return joined


def has_checkpoint(path: Path) -> bool:
    """Return whether a checkpoint lies there, whole or in parts."""
    return path.exists() or _index_path(path).exists()


def _save_parts(saved: dict[str, Any], path: Path) -> list[Path]:
    """Write the parts, then the index; return the parts' paths."""
    buffer = io.BytesIO()
    torch.save(saved, buffer)
    data = buffer.getbuffer()
    digest = hashlib.sha256(data).hexdigest()
    starts = range(0, len(data), PART_BYTES)
    parts = [path.with_name(f"{path.name}.{digest[:8]}.{number:02d}") for number in range(len(starts))]
    for part, start in zip(parts, starts, strict=True):
        with whole_file(part) as file:
            file.write(data[start : start + PART_BYTES])
    with whole_file(_index_path(path)) as file:
        file.write(json.dumps({"sha256": digest, "bytes": len(data), "parts": [part.name for part in parts]}).encode())
    return parts


def _index_path(path: Path) -> Path:
    return path.with_name(path.name + INDEX)


def _index(path: Path) -> dict[str, Any]:
    index: dict[str, Any] = json.loads(_index_path(path).read_text(encoding="utf-8"))
    return index
