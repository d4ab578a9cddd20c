"""The commands in the documents work: they are run in order, or at least parsed."""

import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import httpx
import pytest

from model.cli.main import _parser as model_parser
from service.cli.main import _parser as hof_parser
from service.cli.main import main as hof
from service.settings import Settings
from tests.project.documents import DOCUMENTS, ROOT, commands, name_of, shell_blocks, text_of
from tests.support.server import Server, running

SCRIPT_TIMEOUT_S = 120
WITH_CURL = [document for document in DOCUMENTS if "curl " in "".join(commands(document.read_text("utf-8")))]
WITH_HOF = [document for document in DOCUMENTS if commands(document.read_text("utf-8"), "hof")]

# How each program's lines are checked. What is not run here: Docker, Kubernetes, installations.
PROJECT = ("hof", "hof-model", "make", ".venv/bin/pytest", ".venv/bin/python")
CHECKED = ("curl", *PROJECT, "docker", "kubectl", "pip", "npm", "python3")
TRIVIAL = ("cd", "export", "git", ".")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, u2net: Path) -> Iterator[Server]:
    """Run the service as `make serve` does, with the shipped models and matting, and an empty store."""
    store = f"sqlite:///{tmp_path_factory.mktemp('store') / 'hof.db'}"
    with running(Settings(database_url=store, matting_model=u2net, threads=1)) as server:
        yield server


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a working folder with the project's pictures, and a database that no other test uses."""
    folder = tmp_path / "project"
    shutil.copytree(ROOT / "demo", folder / "demo")
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HOF_DATABASE_URL", f"sqlite:///{tmp_path / 'doctor.db'}")
    monkeypatch.setenv("HOF_PORT", "0")  # `hof doctor` fails if the port is in use
    return folder


def run_curl_blocks(document: str, folder: Path, server: Server) -> str:
    """Run the blocks with curl as one shell script, as if pasted in order; return what it printed."""
    bash = shutil.which("bash")
    assert bash, "the documents' commands need bash"
    blocks = [block for block in shell_blocks(text_of(document)) if "curl " in block]
    script = "".join(blocks).replace("localhost:8080", f"127.0.0.1:{server.port}")
    run = subprocess.run(
        [bash, "-euo", "pipefail", "-c", script],
        cwd=folder,
        capture_output=True,
        timeout=SCRIPT_TIMEOUT_S,
        check=False,
    )
    assert run.returncode == 0, run.stderr.decode()
    return run.stdout.decode(errors="replace")


@pytest.mark.parametrize("document", WITH_CURL, ids=name_of)
def test_curl_lines_pasted_in_order_succeed(document: Path, project: Path, service: Server) -> None:
    run_curl_blocks(name_of(document), project, service)
    lines = [line for line in commands(document.read_text("utf-8")) if "curl " in line]
    assert [line for line in lines if " -f " not in line and " -fsS " not in line] == []
    outputs = re.findall(r" -o (\S+)", "\n".join(lines))
    assert [name for name in outputs if not (project / name).stat().st_size] == []


def test_curl_lines_of_the_readme_give_the_object(project: Path, service: Server) -> None:
    assert len([line for line in commands(text_of("README.md")) if "curl " in line]) == 6
    printed = run_curl_blocks("README.md", project, service)
    with httpx.Client(base_url=f"http://127.0.0.1:{service.port}", timeout=60) as client:
        stored = client.post("/encode", content=(project / "demo" / "armchair.png").read_bytes()).json()
        points = client.get(stored["links"]["points"], params={"n": 100_000}).content
        surface = client.get(stored["links"]["mesh"], params={"format": "stl"}).content
    assert (project / "object.ply").read_bytes() == points
    assert (project / "object.stl").read_bytes() == surface
    assert (project / "object.glb").read_bytes()[:4] == b"glTF"
    assert '"kind":"imported"' in printed


@pytest.mark.parametrize("document", WITH_HOF, ids=name_of)
def test_hof_lines_in_order_succeed(document: Path, project: Path) -> None:
    for line in commands(document.read_text("utf-8"), "hof"):
        arguments = shlex.split(re.sub(r" >+ \S+$", "", line), comments=True)[1:]
        if arguments[0] == "serve":
            assert callable(hof_parser().parse_args(arguments).run)
        else:
            assert hof(arguments) == 0, line


@pytest.mark.parametrize(
    "line", [line for path in DOCUMENTS for line in commands(path.read_text("utf-8"), "hof-model")]
)
def test_hof_model_line_parses(line: str) -> None:
    try:
        arguments = model_parser().parse_args(shlex.split(line, comments=True)[1:])
    except SystemExit:
        pytest.fail(f"hof-model rejects {line!r}")
    assert callable(arguments.run)


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_programs_of_a_document_are_ones_that_are_checked(document: Path) -> None:
    lines = commands(document.read_text("utf-8"))
    others = [line for line in lines if line.split()[0] not in (*CHECKED, *TRIVIAL) and "$(curl " not in line]
    assert others == []


def test_pytest_lines_name_existing_tests() -> None:
    lines = [line for path in DOCUMENTS for line in commands(path.read_text("utf-8"), ".venv/bin/pytest")]
    paths = re.findall(r"\btests/\S+", "\n".join(lines))
    assert len(paths) >= 2
    assert [path for path in paths if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_python_modules_in_a_document_exist(document: Path) -> None:
    modules = re.findall(r"python -m ([\w.]+)", document.read_text("utf-8"))
    assert [module for module in modules if find_spec(module) is None] == []


def test_docker_lines_fit_the_image() -> None:
    dockerfile = text_of("Dockerfile")
    lines = [line for path in DOCUMENTS for line in commands(path.read_text("utf-8"), "docker") if " run " in line]
    assert lines
    for line in lines:
        port, folder = re.findall(r"-p [\d.:]+:(\d+) -v \w+:(\S+)", line)[0]
        assert f"EXPOSE {port}\n" in dockerfile
        assert f"VOLUME {folder}\n" in dockerfile


def test_pip_line_installs_the_same_model_as_make() -> None:
    lines = [line for path in DOCUMENTS for line in commands(path.read_text("utf-8"), "pip")]
    requirements = re.findall(r"\S+==\S+", "\n".join(lines))
    assert requirements
    assert [requirement for requirement in requirements if requirement not in text_of("Makefile")] == []
