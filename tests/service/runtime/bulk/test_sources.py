"""Lists of photos for `hof encode-many`."""

import os
from pathlib import Path

import pytest

from service.errors import InvalidParameter
from service.runtime.bulk.sources import chunks, photos_of


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("b.png", "a.JPG", "notes.txt", ".hidden.png", "sub/c.webp", ".cache/d.png"):
        path = tmp_path / "photos" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path / "photos"


@pytest.mark.usefixtures("folder")
def test_photos_of_a_folder_are_its_images_in_order() -> None:
    assert list(photos_of("photos")) == ["photos/a.JPG", "photos/b.png", "photos/sub/c.webp"]


def test_photos_of_a_list_are_its_lines_whatever_their_suffix(tmp_path: Path) -> None:
    (tmp_path / "list.txt").write_bytes(b"z.png\r\n\na name.jpeg\nno-suffix\n\xff.png")
    names = list(photos_of(str(tmp_path / "list.txt")))
    assert names == ["z.png", "a name.jpeg", "no-suffix", os.fsdecode(b"\xff.png")]


@pytest.mark.usefixtures("folder")
def test_photos_of_a_photo_is_that_photo() -> None:
    assert list(photos_of("photos/b.png")) == ["photos/b.png"]


@pytest.mark.usefixtures("folder")
def test_photos_of_a_pattern_are_its_files_in_order() -> None:
    assert list(photos_of("photos/**/*.[pw]*")) == ["photos/b.png", "photos/sub/c.webp"]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("source", ["missing", "photos/*.gif"])
def test_photos_of_nothing_are_refused(source: str) -> None:
    with pytest.raises(InvalidParameter, match="no such file or folder"):
        list(photos_of(source))


def test_chunks_have_the_size_but_for_the_last() -> None:
    assert list(chunks("abcde", 2)) == [("a", "b"), ("c", "d"), ("e",)]
    assert list(chunks([], 2)) == []
