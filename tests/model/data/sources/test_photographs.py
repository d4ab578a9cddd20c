"""The list of photographs, and packages of npm."""

import hashlib
import io
import json
import os
import tarfile
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler
from pathlib import Path

import pytest

from model.data.sources.npm import unpack_package
from model.data.sources.photographs import listed, scenery_files
from tests.support.server import answering


@pytest.fixture
def registry(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Run a registry of npm, the files of a folder, and let npm use it and a cache of its own."""
    folder = tmp_path_factory.mktemp("registry")
    monkeypatch.setenv("NPM_CONFIG_CACHE", str(tmp_path_factory.mktemp("cache")))
    with answering(partial(SimpleHTTPRequestHandler, directory=folder)) as address:
        monkeypatch.setenv("NPM_CONFIG_REGISTRY", address)
        yield folder


def publish(registry: Path, name: str, version: str, content: bytes) -> None:
    """Put a package with one file, photo.jpg, into a registry."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        for path, data in (("photo.jpg", content), ("package.json", json.dumps({"name": name}).encode())):
            file = tarfile.TarInfo(f"package/{path}")
            file.size = len(data)
            archive.addfile(file, io.BytesIO(data))
    (registry / f"{name}.tgz").write_bytes(packed.getvalue())
    address = f"{os.environ['NPM_CONFIG_REGISTRY']}/{name}.tgz"
    dist = {"tarball": address, "shasum": hashlib.sha1(packed.getvalue(), usedforsecurity=False).hexdigest()}
    versions = {version: {"name": name, "version": version, "dist": dist}}
    (registry / name).write_text(json.dumps({"name": name, "dist-tags": {"latest": version}, "versions": versions}))


def test_listed_photographs_are_of_pinned_packages_and_have_names_of_their_own() -> None:
    packages = listed()["npm"]
    names = [f"{package.split('@')[0]}-{Path(path).stem}" for package, paths in packages.items() for path in paths]
    assert len(names) == len(set(names)) > 150
    assert all(package.split("@")[1].replace(".", "").isdigit() for package in packages)


def test_scenery_files_of_what_is_downloaded_are_those_of_the_list(tmp_path: Path) -> None:
    folder = tmp_path / "photographs"
    folder.mkdir()
    for name in ("tabler-ui-davide-cantelli-139887-1500.jpg", "tabler-ui-bobby-burch-145906-1500.jpg"):
        (folder / name).touch()
    assert [path.name for path in scenery_files(tmp_path) if path.parent == folder] == [
        "tabler-ui-davide-cantelli-139887-1500.jpg"
    ]


def test_unpack_package_without_npm_names_what_brings_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"npm is missing: install Node\.js"):
        unpack_package("tabler-ui@0.0.34", tmp_path)


def test_unpack_package_that_the_registry_lacks_names_it(registry: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"`npm pack frames@1\.0\.0` failed: (?s:.*)404"):
        unpack_package("frames@1.0.0", tmp_path)
    assert registry.is_dir()


def test_unpack_package_of_a_registry_is_unpacked_once(registry: Path, tmp_path: Path) -> None:
    publish(registry, "photos", "1.0.0", b"a photo")
    folder = unpack_package("photos@1.0.0", tmp_path)
    assert (folder / "photo.jpg").read_bytes() == b"a photo"
    (registry / "photos").unlink()
    assert unpack_package("photos@1.0.0", tmp_path) == folder
