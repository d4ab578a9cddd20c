"""The README says what is: its settings, targets, links and commands are held against the code, its curl lines run."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import httpx
import pytest

from model.cli.main import _parser as model_parser
from service import cli
from service.formats.mesh.registry import MESH_FORMATS
from service.formats.points.registry import POINT_FORMATS
from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import Server

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text("utf-8")
SECURITY = (ROOT / "SECURITY.md").read_text("utf-8")
CURL_TIMEOUT_S = 30


def _commands(program: str) -> list[str]:
    """The lines of the README's shell blocks that run a program."""
    blocks = re.findall(r"^```sh\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line.split()[0] == program]
    assert lines
    return lines


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder that holds the photo of the README's lines."""
    folder = tmp_path / "here"
    folder.mkdir()
    shutil.copy(ROOT / "demo" / "coffee.jpg", folder / "photo.jpg")
    monkeypatch.chdir(folder)
    return folder


def _setting_row(name: str) -> str:
    """What the README's table must say of a setting."""
    field = Settings.model_fields[name]
    what, _, told = str(field.description).partition("; default: ")
    value = field.default
    if isinstance(value, Path):
        value = value.relative_to(ROOT)
    default = told if field.default_factory else "none" if value is None else f"`{value}`"
    return f"| `--{name.replace('_', '-')}` | `HOF_{name.upper()}` | {default} | {what} |"


def test_the_table_of_settings_is_that_of_the_code() -> None:
    rows = [line for line in README.splitlines() if line.startswith("| `--")]
    assert rows == [_setting_row(name) for name in Settings.model_fields]


def test_the_table_of_limits_is_that_of_the_code() -> None:
    rows = [line for line in SECURITY.splitlines() if line.startswith("| `HOF_")]
    named = {row.split("`")[1].removeprefix("HOF_").lower() for row in rows}
    assert named > {name for name in Settings.model_fields if name.startswith("max_")}
    without_flag = {name: "|" + _setting_row(name).split("|", 2)[2] for name in Settings.model_fields}
    assert rows == [row for name, row in without_flag.items() if name in named]


def test_the_performance_section_quotes_what_was_measured() -> None:
    section = README.partition("## Performance\n")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")]
    assert len(rows) > 10
    assert set(rows) <= set((ROOT / "benchmarks" / "RESULTS.md").read_text("utf-8").splitlines())


def test_the_formats_are_those_of_the_code() -> None:
    told = re.search(r"^Formats: (.*?), by", README, re.MULTILINE)
    assert told
    assert re.findall(r"`(\w+)`", told[1]) == list(POINT_FORMATS)
    told = re.search(r"^Surfaces: (.*?), by", README, re.MULTILINE)
    assert told
    assert re.findall(r"`(\w+)`", told[1]) == list(MESH_FORMATS)


def test_every_make_target_that_is_named_exists() -> None:
    documents = [README, (ROOT / ".ci" / "run").read_text(), (ROOT / "CHANGELOG.md").read_text()]
    named = {target for text in documents for target in re.findall(r"(?:^|`|run )make ([a-z]+)", text, re.MULTILINE)}
    targets = set(re.findall(r"^([a-z]+):.*## ", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert {"demo", "serve", "test", "results", "bench", "lint"} <= named
    assert named <= targets


def test_every_file_that_is_linked_exists() -> None:
    for document in (ROOT / "README.md", ROOT / "SECURITY.md", ROOT / "deploy" / "README.md"):
        linked = re.findall(r"\]\(([^):]+)\)", document.read_text("utf-8"))
        assert linked
        assert [link for link in linked if not (document.parent / link).is_file()] == []


def test_every_file_of_the_layout_exists() -> None:
    folders = re.findall(r"^\| `(\w+/)`", README, re.MULTILINE)
    assert folders
    assert [folder for folder in folders if not (ROOT / folder).is_dir()] == []


def test_the_hof_lines_work(here: Path, model_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOF_MODEL", str(model_path))
    monkeypatch.setenv("HOF_DATABASE_URL", f"sqlite:///{here.parent / 'doctor.db'}")
    for line in _commands("hof"):
        assert cli.main(shlex.split(line, comments=True)[1:]) == 0, line
    written = {path.name for path in here.iterdir()}
    made = {"object.glb", "object.safetensors", "object.ply", "surface.glb", "composed.glb", "sheet.png"}
    assert written == {"photo.jpg", *made}


def test_the_hof_model_lines_parse() -> None:
    for line in _commands("hof-model"):
        try:
            arguments = model_parser().parse_args(shlex.split(line, comments=True)[1:])
        except SystemExit:
            pytest.fail(f"hof-model does not take the README's line {line!r}")
        assert callable(arguments.run)


def test_the_curl_lines_work(here: Path, server: Server, client: httpx.Client) -> None:
    bash, curl = shutil.which("bash"), shutil.which("curl")
    assert bash, "the README's lines need bash"
    assert curl, "the README's lines need curl"
    (here / ".curlrc").write_text("fail-with-body\nsilent\nshow-error\n")
    stored = client.post("/encode", files={"image": (here / "photo.jpg").read_bytes()}).json()
    other = client.post("/encode", content=image_file(disc())).json()
    ids = {"ID": stored["id"], "A": stored["id"], "B": other["id"]}
    lines = _commands("curl")
    for line in lines:
        run = subprocess.run(
            [bash, "-c", line.replace("localhost:8080", f"127.0.0.1:{server.port}")],
            env={"PATH": str(Path(curl).parent), "CURL_HOME": str(here), **ids},
            capture_output=True,
            timeout=CURL_TIMEOUT_S,
            check=False,
        )
        assert run.returncode == 0, (line, run.stdout, run.stderr)
        if line.endswith("/encode"):
            assert f'"id":"{stored["id"]}"'.encode() in run.stdout
    points = client.get(stored["links"]["points"], params={"n": 100_000})
    assert len(lines) == 6 + 2
    assert (here / "object.stl").read_bytes() == client.get(f"{stored['links']['mesh']}?format=stl").content
    assert (here / "object.ply").read_bytes() == points.content
    assert (here / "object.glb").read_bytes()[:4] == b"glTF"
    assert {item["kind"] for item in client.get("/objects").json()["items"]} == {"encoded", "imported", "composed"}
