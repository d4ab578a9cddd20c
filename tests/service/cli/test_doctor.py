"""`hof doctor` in processes of its own, on installations that are whole and that are not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import ROOT

TIMEOUT_S = 300


def _doctor(folder: Path, model: Path, **settings: str) -> tuple[int, dict[str, tuple[str, str]]]:
    """Exit status, and by what was checked its state and what was told."""
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(("HOF_", "OTEL_", "U2NET_"))
    }
    environment |= {"PYTHONPATH": str(ROOT), "HOF_MODEL": str(model), "HOF_DATABASE_URL": f"sqlite:///{folder}/hof.db"}
    run = subprocess.run(
        [str(Path(sys.executable).with_name("hof")), "doctor"],
        env=environment | settings,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert run.stderr == ""
    found = {}
    for line in run.stdout.splitlines():
        state, what, told = line.split(maxsplit=2)
        found[what] = (state, told)
    assert found.keys() == {"model", "matting", "database", "disk", "page", "keys", "threads", "[fast]", "[otel]"}
    return run.returncode, found


def test_a_whole_installation_is_well(model_path: Path, tmp_path: Path, u2net_home: Path) -> None:
    status, found = _doctor(tmp_path, model_path, U2NET_HOME=str(u2net_home), HOF_THREADS="1")
    assert status == 0
    assert {state for what, (state, _) in found.items() if what != "disk"} == {"ok"}
    assert "tiny-k2" in found["model"][1]


def test_what_is_broken_is_told_and_does_not_hide_the_rest(tmp_path: Path) -> None:
    (tmp_path / "cut.onnx").write_bytes(b"\x08\x07")
    (tmp_path / "hof.db").write_bytes(b"no database" * 1000)
    (tmp_path / "keys").write_text("shop fly 1\n")
    broken = {"HOF_MATTING_MODEL": "gone.onnx", "HOF_API_KEYS_FILE": "keys", "HOF_THREADS": "1000"}
    status, found = _doctor(tmp_path, tmp_path / "cut.onnx", OTEL_EXPORTER_OTLP_ENDPOINT="http://127.0.0.1:1", **broken)
    assert status == 1
    told = [
        ("model", "fail", "cut.onnx is unusable"),
        ("matting", "fail", "cannot read the matting model gone.onnx"),
        ("database", "fail", "cannot open the database"),
        ("keys", "fail", "line 1 of the keys file keys is malformed"),
        ("threads", "warn", "1000 on"),
        ("[otel]", "ok", "installed"),
    ]
    for what, state, text in told:
        assert found[what][0] == state, what
        assert text in found[what][1]
    assert found["page"][0] == found["[fast]"][0] == "ok"


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("sqlite:///file:hof.db?mode=ro&uri=true", "cannot be written"),
        ("nonsense", "invalid database URL"),
        ("postgresql://u:secret@127.0.0.1:1/x", "cannot open the database postgresql://u:***@"),
    ],
)
def test_a_database_that_cannot_be_used_fails(model_path: Path, tmp_path: Path, url: str, message: str) -> None:
    assert _doctor(tmp_path, model_path)[0] == 0  # makes hof.db
    status, found = _doctor(tmp_path, model_path, HOF_DATABASE_URL=url, HOF_HOST="0.0.0.0")
    assert (status, found["database"][0]) == (1, "fail")
    assert message in found["database"][1]
    assert "secret" not in str(found)
    assert found["keys"][0] == "warn"
