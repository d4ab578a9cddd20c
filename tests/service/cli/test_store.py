"""`hof store`: export, import and copy."""

import asyncio
import sys
from pathlib import Path

import pytest

from service.cli.main import main
from service.cli.progress import line
from tests.support.small.store import fill, open_store, pair_of


@pytest.fixture
def source(tmp_path: Path) -> str:
    url = f"sqlite:///{tmp_path / 'source.db'}"

    async def scenario() -> None:
        async with open_store(url) as store:
            await fill(store)

    asyncio.run(scenario())
    return url


def _ids(url: str) -> list[str]:
    async def scenario() -> list[str]:
        async with open_store(url) as store:
            return [record.id for record in (await store.page(50))[0]]

    return asyncio.run(scenario())


def test_export_then_import_moves_all_objects(source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, target = str(tmp_path / "objects.parquet"), f"sqlite:///{tmp_path / 'target.db'}"
    assert main(["store", "export", file, "--database-url", source]) == 0
    assert main(["store", "import", file, "--database-url", target]) == 0
    assert main(["store", "import", file, "--database-url", target]) == 0
    assert capsys.readouterr().err == (
        f"hof: {file}: 6 objects\n"
        "hof: 6 new objects, 0 that were there already\n"
        "hof: 0 new objects, 6 that were there already\n"
    )
    assert _ids(target) == _ids(source)


def test_copy_ends_with_1_if_an_object_differs(source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = f"sqlite:///{tmp_path / 'target.db'}"
    assert main(["store", "copy", source, target]) == 0

    async def replace_one() -> None:
        async with open_store(target) as store:
            await store.delete(pair_of(2)[0].id)
            await store.put(pair_of(2)[0], pair_of(1)[1])

    asyncio.run(replace_one())
    capsys.readouterr()
    assert main(["store", "copy", source, target]) == 1
    assert f"1 objects are there with other content, and stay as they are: {pair_of(2)[0].id}\n" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize("command", ["export", "copy"])
def test_reading_of_a_missing_file_creates_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    missing, out = f"sqlite:///{tmp_path / 'missing.db'}", str(tmp_path / "out.parquet")
    arguments = {"export": [out, "--database-url", missing], "copy": [missing, f"sqlite:///{tmp_path / 'target.db'}"]}
    assert main(["store", command, *arguments[command]]) == 2
    assert "does not exist" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["export", "import"])
def test_without_pyarrow_the_message_names_the_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["store", command, str(tmp_path / "objects.parquet")]) == 2
    assert "needs the extra `bulk`" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((0, 1000, 0, 0.0), "0 of 1,000 photos"),
        ((500, 1000, 100, 10.0), "500 of 1,000 photos, 10.0 photos/s, 0:00:50 left"),
        ((1000, 1_000_000, 1000, 10.0), "1,000 of 1,000,000 photos, 100.0 photos/s, 2:46:30 left"),
    ],
)
def test_progress_line_gives_speed_and_time_left_of_this_run(numbers: tuple[int, int, int, float], text: str) -> None:
    assert line(*numbers, "photos") == text
