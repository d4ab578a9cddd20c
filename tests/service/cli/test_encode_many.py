"""`hof encode-many`: a folder of photos becomes a table that a store imports."""

import sys
from pathlib import Path

import httpx
import pyarrow.parquet as pq
import pytest

from service.cli.main import main
from service.settings import Settings
from tests.support.photos import disc, image_file


def test_objects_of_a_table_are_those_of_the_service(
    here: Path, client: httpx.Client, settings: Settings, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "blue.png").write_bytes(image_file(disc("blue")))
    (here / "bad.png").write_bytes(b"")
    assert main(["encode-many", ".", "-o", "objects.parquet", "--processes", "1"]) == 0
    report = "hof: objects.parquet: 2 objects, 1 photos that could not be encoded (column error)\n"
    assert capsys.readouterr().err == report
    assert main(["store", "import", "objects.parquet", "--database-url", settings.database_url]) == 0
    assert capsys.readouterr().err == "hof: 2 new objects, 0 that were there already, 1 rows without an object\n"
    rows = {row["source"]: row for row in pq.read_table("objects.parquet").to_pylist()}
    for name in ("photo.png", "blue.png"):
        answer = client.post("/encode", content=(here / name).read_bytes())
        assert answer.status_code == 200  # the imported object
        assert answer.json()["id"] == rows[f"./{name}"]["id"]
        weights = client.get(answer.json()["links"]["weights"], params={"format": "json"}).json()
        assert weights["theta"] == rows[f"./{name}"]["theta"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--processes", "0"], "processes is 0, it must be 1 or more"),
        (["--foreground-ratio", "3"], "foreground_ratio"),
        (["--model", "missing.onnx"], "cannot read the model missing.onnx"),
    ],
)
def test_faulty_options_are_refused_before_any_photo(
    here: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert main(["encode-many", ".", "-o", "objects.parquet", *options]) == 2
    assert message in capsys.readouterr().err
    assert sorted(path.name for path in here.iterdir()) == ["photo.png"]


@pytest.mark.usefixtures("here")
def test_without_the_extra_the_message_names_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pebble", None)
    assert main(["encode-many", ".", "-o", "objects.parquet"]) == 2
    assert "needs the extra `bulk`" in capsys.readouterr().err
