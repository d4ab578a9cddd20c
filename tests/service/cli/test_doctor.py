"""`hof doctor` on complete and on faulty installations: as a process where that matters, else within the tests'."""

import asyncio
import os
import shutil
import socket
import sqlite3
import subprocess
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from service.cli.main import main
from service.encoding.compiled import NOT_BUILT
from service.settings import SHIPPED_MATTING
from service.storage import database
from tests.service.mapping.engines import built_kernel, needs_kernel
from tests.support import ROOT
from tests.support.processes import HOF, USER_WITHOUT_HOME
from tests.support.systems.postgres import Postgres

SCHEMAS = ROOT / "tests" / "service" / "storage" / "schemas"
SUBJECTS = {"model", "matting", "database", "disk", "page", "keys", "threads", "kernel", "[otel]", "address"}
TIMEOUT_S = 300
pytestmark = pytest.mark.slow  # tests start Python and load the model

Report = tuple[int, dict[str, tuple[str, str]]]  # exit status; state and message by subject


def _doctor(folder: Path, model: Path, **settings: str) -> Report:
    """Run `hof doctor` as a process."""
    run = subprocess.run(
        [HOF, "doctor"],
        env=_environment(folder, model, settings) | {"PYTHONPATH": settings.get("PYTHONPATH", str(ROOT))},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    return _report(run.returncode, run.stdout, run.stderr)


@pytest.fixture
def doctor(
    model_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., Report]:
    """Return a function that runs `hof doctor` in this process, with the given variables, in the test's folder."""

    def run(**settings: str) -> Report:
        environment = _environment(tmp_path, model_path, settings)
        for name in os.environ.keys() - environment.keys():
            monkeypatch.delenv(name)
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        monkeypatch.chdir(tmp_path)
        status = main(["doctor"])
        return _report(status, *capfd.readouterr())

    return run


def _environment(folder: Path, model: Path, settings: dict[str, str]) -> dict[str, str]:
    """Return the variables of this process, with those of a service in place of those it has."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("HOF_", "OTEL_"))}
    own = {"HOF_MODEL": str(model), "HOF_DATABASE_URL": f"sqlite:///{folder}/hof.db", "HOF_PORT": "0"}
    return inherited | {"HOF_MATTING_MODEL": "none"} | own | settings


def _report(status: int, out: str, err: str) -> Report:
    """Return the exit status and, by subject, the state and message of each check."""
    assert err == ""
    findings = {}
    for line in out.splitlines():
        state, subject, message = line.split(maxsplit=2)
        findings[subject] = (state, message)
    assert findings.keys() == SUBJECTS
    return status, findings


def test_doctor_of_a_complete_installation_is_ok(model_path: Path, tmp_path: Path) -> None:
    status, findings = _doctor(tmp_path, model_path, HOF_THREADS="1", HOF_MATTING_MODEL=str(SHIPPED_MATTING))
    assert status == 0
    assert {state for subject, (state, _) in findings.items() if subject != "disk"} == {"ok"}
    assert "tiny-k2" in findings["model"][1]


@needs_kernel
def test_doctor_without_the_compiled_loops_over_pixels_warns(model_path: Path, tmp_path: Path) -> None:
    built_kernel()
    ignored = shutil.ignore_patterns("_pixels*", "bundle", "node_modules", "__pycache__")
    shutil.copytree(ROOT / "service", tmp_path / "tree" / "service", ignore=ignored)
    status, findings = _doctor(tmp_path, model_path, PYTHONPATH=str(tmp_path / "tree"))
    assert (status, findings["kernel"]) == (0, ("warn", NOT_BUILT))


def test_doctor_of_a_broken_installation_names_each_fault(tmp_path: Path) -> None:
    (tmp_path / "cut.onnx").write_bytes(b"\x08\x07")
    (tmp_path / "hof.db").write_bytes(b"no database" * 1000)
    (tmp_path / "keys").write_text("shop fly 1\n")
    broken = {"HOF_MATTING_MODEL": "gone.onnx", "HOF_API_KEYS_FILE": "keys", "HOF_THREADS": "1000"}
    status, findings = _doctor(
        tmp_path, tmp_path / "cut.onnx", OTEL_EXPORTER_OTLP_ENDPOINT="http://127.0.0.1:1", **broken
    )
    assert status == 1
    expected = [
        ("model", "fail", "cut.onnx is unusable"),
        ("matting", "fail", "cannot read the matting model gone.onnx"),
        ("database", "fail", "cannot open the database"),
        ("keys", "fail", "line 1 of the keys file keys is malformed"),
        ("threads", "warn", "1000 on"),
        ("[otel]", "ok", "installed"),
    ]
    for subject, state, text in expected:
        assert findings[subject][0] == state, subject
        assert text in findings[subject][1]
    assert findings["page"][0] == "ok"


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("sqlite:///file:hof.db?mode=ro&uri=true", "cannot be written"),
        ("nonsense", "invalid database URL"),
        ("postgresql://u:secret@127.0.0.1:1/x", "cannot open the database postgresql://u:***@"),
        ("postgres://u:secret@127.0.0.1:port/x", "cannot read its hosts and ports"),
        ("mysql://u:secret@127.0.0.1/x", "invalid database URL"),
    ],
)
def test_doctor_of_an_unusable_database_fails(
    doctor: Callable[..., Report], tmp_path: Path, url: str, message: str
) -> None:
    asyncio.run(database.verify(f"sqlite:///{tmp_path}/hof.db"))  # creates hof.db
    status, findings = doctor(HOF_DATABASE_URL=url, HOF_HOST="0.0.0.0")
    assert (status, findings["database"][0]) == (1, "fail")
    assert message in findings["database"][1]
    assert "secret" not in str(findings)
    assert findings["keys"][0] == "warn"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become a user without a passwd entry")
@pytest.mark.parametrize("command", ["doctor", "serve"])
def test_command_of_a_user_without_home_says_which_setting_helps(command: str) -> None:
    run = subprocess.run(
        [*USER_WITHOUT_HOME, "-u", "HOF_DATABASE_URL", HOF, command],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd="/",  # the tests' folder is closed to that user
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    text = run.stdout + run.stderr
    assert run.returncode in (1, 2)
    assert "this user has no home folder; set --database-url or HOF_DATABASE_URL" in text
    assert "Traceback" not in text
    assert not Path("/~").exists()


def test_doctor_creates_nothing(doctor: Callable[..., Report], tmp_path: Path) -> None:
    status, findings = doctor(HOF_DATABASE_URL=f"sqlite:///{tmp_path}/new/folder/hof.db")
    assert (status, findings["database"][0]) == (0, "ok")
    assert "will be created" in findings["database"][1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("schema", "note"),
    [
        ("", "; it is empty, and `hof serve` will create its tables"),
        ("first-schema", "; an older version of hof wrote it, and `hof serve` will migrate it: make a backup first"),
        ("version-0.1.0", "; an older version of hof wrote it, and `hof serve` will migrate it: make a backup first"),
        ("this version", ""),
    ],
)
def test_doctor_of_an_existing_database_changes_nothing(
    doctor: Callable[..., Report], tmp_path: Path, schema: str, note: str
) -> None:
    url = f"sqlite:///{tmp_path}/hof.db"
    if schema == "this version":
        asyncio.run(database.verify(url))
    else:
        dump = (SCHEMAS / f"{schema}.sqlite.sql").read_text("utf-8") if schema else ""
        with closing(sqlite3.connect(tmp_path / "hof.db")) as connection:
            connection.executescript(dump)
    before = _contents(tmp_path)
    status, findings = doctor()
    assert (status, findings["database"]) == (0, ("ok", f"{url} can be read and written{note}"))
    assert _contents(tmp_path) == before


def _contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir()}


def test_doctor_of_an_empty_postgres_creates_no_table(doctor: Callable[..., Report], postgres: Postgres) -> None:
    url = postgres.create()
    status, findings = doctor(HOF_DATABASE_URL=url)
    assert (status, findings["database"][0]) == (0, "ok")
    assert "`hof serve` will create its tables" in findings["database"][1]
    name = url.rpartition("/")[2]
    assert postgres.run("SELECT count(*) FROM pg_tables WHERE schemaname = 'public'", name) == "0"
    postgres.run("CREATE ROLE guest LOGIN", name)
    status, findings = doctor(HOF_DATABASE_URL=url.replace("postgres@", "guest@"))
    assert (status, findings["database"][0]) == (1, "fail")
    assert "may not create tables" in findings["database"][1]


def test_doctor_with_a_port_in_use_fails_as_serve_does(doctor: Callable[..., Report]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        status, findings = doctor(HOF_PORT=port)
    assert (status, findings["address"][0]) == (1, "fail")
    assert port in findings["address"][1]
