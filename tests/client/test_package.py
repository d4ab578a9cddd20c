"""The distribution: it needs httpx and NumPy alone, and its version is the service's."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import hof_client
import service
from hof_client import problems
from tests.support import ROOT

PROJECT = tomllib.loads((ROOT / "client" / "pyproject.toml").read_text("utf-8"))["project"]
BARE = """
import sys
sys.path = [*sys.argv[1:], *(path for path in sys.path if "site-packages" not in path)]
import hof_client
assert hof_client.Client("http://localhost")
assert not {"service", "model", "onnxruntime", "pydantic"} & set(sys.modules)
"""


def _required(name: str) -> set[str]:
    """Return the name of a distribution and of all that it requires here."""
    requirements = map(Requirement, distribution(name).requires or ())
    needed = [each.name for each in requirements if each.marker is None or each.marker.evaluate({"extra": ""})]
    return {name}.union(*(_required(each) for each in needed))


def test_client_with_its_requirements_alone_starts(tmp_path: Path) -> None:
    declared = [Requirement(line).name for line in PROJECT["dependencies"]]
    assert declared == ["httpx", "numpy"]
    for name in set().union(*(_required(each) for each in declared)):
        package = distribution(name)
        tops = {file.parts[0] for file in package.files or () if file.parts[0] not in ("..", "__pycache__")}
        for top in tops:
            (tmp_path / top).symlink_to(Path(str(package.locate_file(top))))
    command = [sys.executable, "-I", "-S", "-c", BARE, str(ROOT / "client" / "src"), str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_locked_versions_satisfy_the_requirements_of_the_client() -> None:
    text = (ROOT / "requirements" / "dev.txt").read_text("utf-8")
    versions = dict(re.findall(r"^([\w.-]+)==(\S+) ", text, re.MULTILINE))
    for requirement in map(Requirement, PROJECT["dependencies"]):
        assert requirement.specifier.contains(versions[canonicalize_name(requirement.name)]), requirement


def test_version_of_the_client_is_that_of_the_service() -> None:
    assert hof_client.__version__ == service.__version__


def test_version_is_read_where_nothing_is_installed() -> None:
    setuptools = tomllib.loads((ROOT / "client" / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    module, _, name = setuptools["dynamic"]["version"]["attr"].rpartition(".")
    tree = ast.parse((ROOT / "client" / "src" / f"{module.replace('.', '/')}.py").read_text("utf-8"))
    values = [node.value for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name]
    assert [ast.literal_eval(value) for value in values] == [hof_client.__version__]


def test_license_of_the_client_is_that_of_the_project() -> None:
    assert (ROOT / "client" / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_errors_of_the_package_are_all_exported() -> None:
    errors = {name for name, kind in vars(problems).items() if isinstance(kind, type)}
    assert errors <= set(hof_client.__all__)
