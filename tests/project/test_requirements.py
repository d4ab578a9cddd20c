"""The service runs with its declared requirements alone, without torch. Layers are checked by lint-imports."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support import ROOT

NAME = "hof-service"
TORCH = re.search(r"^TORCH \?= torch==(\S+)", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE) or ("", "none")
RUN_TIMEOUT_S = 120


def _required(name: str, extras: frozenset[str] = frozenset()) -> dict[str, Distribution]:
    """Return a distribution and all that it requires here, by name, as pip would install them."""
    name = canonicalize_name(name)
    distributions: dict[str, Distribution] = {name: distribution(name)}
    for requirement in map(Requirement, distributions[name].requires or ()):
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in extras | {""}):
            distributions |= _required(requirement.name, frozenset(requirement.extras))
    return distributions


@pytest.mark.parametrize(("file", "extras"), [("service", ("otel", "postgres")), ("dev", ("dev",))])
def test_locked_versions_satisfy_pyproject(file: str, extras: tuple[str, ...]) -> None:
    text = (ROOT / "requirements" / f"{file}.txt").read_text("utf-8")
    versions = dict(re.findall(r"^([\w.-]+)==(\S+) ", text, re.MULTILINE)) | {"torch": TORCH[1]}
    for requirement in _declared(*extras):
        assert requirement.specifier.contains(versions[canonicalize_name(requirement.name)]), requirement


def _declared(*extras: str) -> Iterator[Requirement]:
    """Yield the requirements of pyproject.toml with some extras, less those of other systems."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    named = [*project["dependencies"], *(line for extra in extras for line in project["optional-dependencies"][extra])]
    for requirement in map(Requirement, named):
        if requirement.name == NAME:
            yield from _declared(*requirement.extras)
        elif requirement.marker is None or requirement.marker.evaluate():
            yield requirement


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Make a folder of packages that holds the service and only those installed packages that it requires."""
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "service").symlink_to(ROOT / "service")
    for name, package in _required(NAME).items():
        tops = {file.parts[0] for file in package.files or () if file.parts[0] not in ("..", "__pycache__")}
        for top in tops if name != NAME else ():
            (folder / top).symlink_to(Path(str(package.locate_file(top))))
    return folder


BARE = """
import sys
sys.path = [sys.argv.pop(1), *(path for path in sys.path if "site-packages" not in path)]
from service.cli.main import main
status = main(sys.argv[1:])
assert not {"torch", "model", "onnx", "scipy", "safetensors"} & set(sys.modules)
sys.exit(status)
"""


@pytest.mark.parametrize("command", ["encode photo.png -o points.glb", "openapi"])
def test_service_with_its_requirements_alone_runs(
    site: Path, tmp_path: Path, model_path: Path, photo: bytes, command: str
) -> None:
    (tmp_path / "photo.png").write_bytes(photo)
    run = subprocess.run(
        [sys.executable, "-I", "-S", "-c", BARE, str(site), *command.split()],
        cwd=tmp_path,
        env={"HOF_MODEL": str(model_path)},
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT_S,
        check=False,
    )
    reports = run.stderr.splitlines()
    assert run.returncode == 0, run.stderr
    assert len(reports) == (0 if command == "openapi" else 2)  # one of the photo, one of the file
    assert run.stdout == ((ROOT / "openapi.json").read_text() if command == "openapi" else "")


def test_sources_advise_no_install_of_the_other_project_named_hof() -> None:
    files = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    kinds = (".py", ".md", ".yaml", "Makefile", "Dockerfile")
    texts = [ROOT / name for name in files.split("\0") if name.endswith(kinds)]
    advice = re.compile(r"pip install (?:-\S+ )*['\"]?hof\b(?!-)")
    assert [path.name for path in texts if path.is_file() and advice.search(path.read_text("utf-8"))] == []
