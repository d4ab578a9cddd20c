"""The package: types as the schema has them, what it contains, and what its lock file tells."""

import json
from pathlib import Path

import pytest

import service
from hof_client import problems
from tests.client.js.conftest import Run
from tests.support.systems.javascript import PACKAGE

pytestmark = pytest.mark.system

DESCRIPTION = json.loads((PACKAGE / "package.json").read_text("utf-8"))


def test_types_are_those_of_the_schema(npm: Run, tmp_path: Path) -> None:
    program, schema, *options = DESCRIPTION["scripts"]["schema"].split()
    npm(program, schema, *(option.replace("src/", f"{tmp_path}/") for option in options))
    assert (tmp_path / "schema.ts").read_text() == (PACKAGE / "src" / "schema.ts").read_text(), "run `make openapi`"


def test_calls_that_the_schema_lacks_are_refused_by_the_compiler(npm: Run) -> None:
    npm("tsc", "-p", "test")


def test_package_contains_what_it_exports_and_no_sources(npm: Run, built: Path) -> None:
    (packed,) = json.loads(npm("npm", "pack", "--dry-run", "--json", "--ignore-scripts"))
    files = {each["path"] for each in packed["files"]}
    assert {path.removeprefix("./") for path in DESCRIPTION["exports"].values()} <= files
    assert {"LICENSE", "README.md", "dist/index.d.ts", "dist/function/card.js", "dist/schema.d.ts"} <= files
    assert not [path for path in files if path.endswith(".ts") and not path.endswith(".d.ts")]


def test_package_needs_no_other_to_run() -> None:
    assert "dependencies" not in DESCRIPTION
    assert DESCRIPTION["private"] is True


def test_lock_file_names_no_registry() -> None:
    assert "resolved" not in (PACKAGE / "package-lock.json").read_text("utf-8")


def test_versions_of_packages_are_exact() -> None:
    versions = [*DESCRIPTION["devDependencies"].values()]
    assert [version for version in versions if not version[0].isdigit()] == []


def test_version_of_the_package_is_that_of_the_service() -> None:
    assert DESCRIPTION["version"].replace("-dev.", ".dev") == service.__version__


def test_license_of_the_package_is_that_of_the_project() -> None:
    assert (PACKAGE / "LICENSE").read_bytes() == (PACKAGE.parents[1] / "LICENSE").read_bytes()


def test_problem_types_are_those_of_the_service(npm: Run, built: Path) -> None:
    code = 'import { PROBLEM_TYPES } from "hof-client"; console.log(JSON.stringify(PROBLEM_TYPES));'
    titles = {
        kind.title for kind in vars(problems).values() if isinstance(kind, type) and issubclass(kind, problems.Problem)
    }
    expected = {"urn:hof:problem:" + title.lower().replace(" ", "-") for title in titles if title}
    assert set(json.loads(npm("node", "--input-type=module", "--eval", code))) == expected
