"""Files that are written whole or not at all."""

import errno
from pathlib import Path

import pytest

from service.files import whole_file


def test_whole_file_that_ends_replaces_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "data.bin"
    path.write_bytes(b"old")
    with whole_file(path) as file:
        file.write(b"new")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_whole_file_with_an_error_leaves_only_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "data.bin"
    path.write_bytes(b"old")
    with pytest.raises(RuntimeError), whole_file(path) as file:  # noqa: PT012
        file.write(b"half")
        raise RuntimeError
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_whole_file_with_an_error_leaves_neither_target_nor_temporary(
    error: type[BaseException], tmp_path: Path
) -> None:
    with pytest.raises(error), whole_file(tmp_path / "data.bin") as file:  # noqa: PT012
        file.write(b"half")
        raise error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("first", "second"), [("x.onnx", "x.md"), ("x.onnx", "x.onnx")])
def test_whole_file_of_two_writers_at_once_keeps_them_apart(first: str, second: str, tmp_path: Path) -> None:
    with whole_file(tmp_path / first) as one, whole_file(tmp_path / second) as other:
        assert one.name != other.name
        one.write(b"one")
        other.write(b"other")
    contents = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert contents == ({first: b"one", second: b"other"} if first != second else {first: b"one"})  # `one` ends last


@pytest.mark.parametrize(("name", "number"), [("nowhere/data.bin", errno.ENOENT), ("folder", errno.EISDIR)])
def test_whole_file_that_cannot_be_written_names_the_target(name: str, number: int, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match=r"data\.bin|folder") as raised, whole_file(tmp_path / name) as file:
        file.write(b"new")
    assert (raised.value.errno, raised.value.filename) == (number, str(tmp_path / name))
    assert list(tmp_path.iterdir()) == [tmp_path / "folder"]
