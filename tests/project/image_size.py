"""Reckon the unpacked size of the Docker image: `python -m tests.project.image_size`.

Its base image, and what the Dockerfile adds: the packages of requirements/service.txt less what it removes, the project
with the page's libraries, and the matting model. Packages are weighed where they are installed here.
"""

import re
from importlib.metadata import distribution
from pathlib import Path
from typing import Final

from tests.support import ROOT

MB: Final = 1e6
BASE_MB: Final = 135.0  # python:3.11-slim-bookworm, unpacked: about 130, which nothing here can weigh
MATTING_MB: Final = 4.6  # u2netp.onnx
REMOVED: Final = re.compile(r"^libonnxruntime\.so\.")
LEFT_OUT: Final = "hof-matte.onnx"  # of the models: U2-Net is there
RECORDS: Final = ROOT / "model" / "results"  # not in the wheel
COMPILED: Final = 1.6  # of Python files: pip adds bytecode
REMOVED_KINDS: Final = {".pyi", ".pyx", ".pxd", ".h", ".c"}
REMOVED_FOLDERS: Final = {"tests", "transformers", "quantization", "tools", "datasets"}  # the last ones of onnxruntime


def image_mb() -> dict[str, float]:
    """Return the parts of the image, in MB; the sum is the image."""
    lock = (ROOT / "requirements" / "service.txt").read_text("utf-8")
    names = re.findall(r"^([\w.-]+)==", lock, re.MULTILINE)
    packages = {name: _package_mb(name) for name in names}
    files = (path for folder in ("service", "model") for path in (ROOT / folder).rglob("*"))
    own = sum(_bytes(path) for path in files if RECORDS not in path.parents)
    largest = sorted(packages.items(), key=lambda item: -item[1])[:5]
    rest = sum(packages.values()) - sum(size for _, size in largest)
    return {
        "base image": BASE_MB,
        **dict(largest),
        f"{len(packages) - len(largest)} other packages": rest,
        "the project and its models": own / MB,
        "the matting model": MATTING_MB,
    }


def _package_mb(name: str) -> float:
    """Return the size of an installed package, with bytecode, in MB."""
    package = distribution(name)
    files = (Path(str(package.locate_file(file))) for file in package.files or () if "__pycache__" not in file.parts)
    kept = (
        file
        for file in files
        if not (REMOVED_FOLDERS & {*file.parts} or REMOVED.search(file.name) or file.suffix in REMOVED_KINDS)
    )
    return sum(_bytes(file) for file in kept) / MB


def _bytes(path: Path) -> float:
    """Return the bytes of a file of the image; 0 for others."""
    if not path.is_file() or path.name == LEFT_OUT or "__pycache__" in path.parts or "node_modules" in path.parts:
        return 0
    return path.stat().st_size * (COMPILED if path.suffix == ".py" else 1)


if __name__ == "__main__":
    parts = image_mb()
    for part, size in parts.items():
        print(f"{size:7.1f} MB  {part}")
    print(f"{sum(parts.values()):7.1f} MB  in all")
