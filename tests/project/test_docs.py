"""The documents agree with the project: links, paths, names, tables of settings, formats, calls and figures."""

import json
import re
import tomllib
from http import HTTPStatus
from pathlib import Path

import pytest

from service.api.app import create_app
from service.formats.mesh.registry import MESH_FORMATS
from service.formats.points.registry import POINT_FORMATS
from service.formats.weights import WEIGHT_FORMATS
from service.settings import Settings
from tests.project import capacity
from tests.project.documents import DOCUMENTS, ROOT, anchors, code, name_of, rows, section, text_of
from tests.project.quoted_figures import QUOTES, Quote, measured_rows
from tests.project.settings_table import names, rewrite

FOLDERS = ("service/", "model/", "client/", "tests/", "benchmarks/", "demo/", "deploy/", "docs/", ".ci/")

each_document = pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)


def test_readme_length_is_at_most_140_lines() -> None:
    assert len(text_of("README.md").splitlines()) <= 140


@each_document
def test_links_of_a_document_lead_somewhere(document: Path) -> None:
    text = document.read_text("utf-8")
    links = re.findall(r'(?:\]\(|src=")([^)"]+)[)"]', text)
    for link in (link for link in links if not link.startswith("https://")):
        path, _, anchor = link.partition("#")
        target = document.parent / path if path else document
        assert target.is_file(), link
        assert not anchor or anchor in anchors(target.read_text("utf-8")), link


@pytest.mark.parametrize("document", [path for path in DOCUMENTS if path.name != "LAB.md"], ids=name_of)
def test_paths_in_a_document_exist(document: Path) -> None:
    text = document.read_text("utf-8")
    words = [word for word in code(text) if word.startswith(FOLDERS) and ("." in word or word.endswith("/"))]
    paths = [word for word in words if not re.search(r"[A-Z]{3}|[ *{]|^model/vnd\.", word)]  # a media type
    assert [path for path in paths if not (ROOT / path).exists()] == []


@each_document
def test_variables_in_a_document_are_settings(document: Path) -> None:
    variables = set(re.findall(r"\bHOF_[A-Z_]+\b", document.read_text("utf-8")))
    assert variables <= {f"HOF_{name.upper()}" for name in Settings.model_fields}


@each_document
def test_make_targets_in_a_document_exist(document: Path) -> None:
    named = set(re.findall(r"(?:^|`|run )make ([a-z-]+)", document.read_text("utf-8"), re.MULTILINE))
    assert named <= set(re.findall(r"^([a-z-]+):.*## ", text_of("Makefile"), re.MULTILINE))


@each_document
def test_extras_in_a_document_exist(document: Path) -> None:
    text = document.read_text("utf-8")
    extras = {extra for group in re.findall(r"\.\[([a-z,]+)\]", text) for extra in group.split(",")}
    assert extras <= set(tomllib.loads(text_of("pyproject.toml"))["project"]["optional-dependencies"])


def test_documents_of_the_folder_are_all_linked_in_the_readme() -> None:
    readme = text_of("README.md")
    assert [path.name for path in (ROOT / "docs").glob("*.md") if f"(docs/{path.name})" not in readme] == []


def test_architecture_names_every_folder_of_the_code() -> None:
    folders = {cells[0].strip("`") for cells in rows(section(text_of("docs/architecture.md"), "Folders"))}
    packages = {
        f"{path.parent.relative_to(ROOT)}/" for top in ("service", "model") for path in ROOT.glob(f"{top}/*/*.py")
    }
    assert packages <= folders


def test_layers_of_the_architecture_equal_the_contracts() -> None:
    contracts = tomllib.loads(text_of("pyproject.toml"))["tool"]["importlinter"]["contracts"]
    layers = {each["containers"][0]: " → ".join(each["layers"]) for each in contracts if "containers" in each}
    assert dict(re.findall(r"^(\w+):  +(.+)$", text_of("docs/architecture.md"), re.MULTILINE)) == layers


def test_settings_tables_equal_settings() -> None:
    text = text_of("docs/operations.md")
    assert sorted(names(text)) == sorted(Settings.model_fields)
    assert text == rewrite(text), "run python -m tests.project.settings_table"


def test_limits_table_of_security_equals_settings() -> None:
    text = text_of("SECURITY.md")
    assert set(names(text)) > {name for name in Settings.model_fields if name.startswith("max_")}
    assert text == rewrite(text), "run python -m tests.project.settings_table"


def test_point_formats_equal_the_registry() -> None:
    table = rows(section(text_of("docs/api.md"), "Points"))
    assert table == [
        [f"`{fmt.name}`", f"`{fmt.media_type}`", f"`{fmt.extension}`", "yes" if fmt.colored else "no"]
        for fmt in POINT_FORMATS.values()
    ]


def test_surface_formats_equal_the_registry() -> None:
    table = rows(section(text_of("docs/surfaces-and-composition.md"), "Surfaces"))
    assert table == [
        [f"`{fmt.name}`", f"`{fmt.media_type}`", f"`{fmt.extension}`", "yes" if fmt.holds_color else "no"]
        for fmt in MESH_FORMATS.values()
    ]


def test_weight_formats_equal_the_registry() -> None:
    table = rows(section(text_of("docs/api.md"), "Weights"))
    assert [cells[0].strip("`") for cells in table] == list(WEIGHT_FORMATS)


def test_calls_and_their_parameters_equal_the_schema() -> None:
    paths = json.loads(text_of("openapi.json"))["paths"]
    schema = {
        f"{method.upper()} {path}": {each["name"] for each in call.get("parameters", []) if each["in"] == "query"}
        for path, calls in paths.items()
        for method, call in calls.items()
    }
    table = rows(section(text_of("docs/api.md"), "Calls"))
    assert {cells[0].strip("`"): set(code(cells[1])) for cells in table} == schema


def test_statuses_of_errors_cover_the_schema() -> None:
    calls = [call for path in json.loads(text_of("openapi.json"))["paths"].values() for call in path.values()]
    answers = {status for call in calls for status in call["responses"] if int(status) >= HTTPStatus.BAD_REQUEST}
    assert {cells[0] for cells in rows(section(text_of("docs/api.md"), "Errors"))} >= answers


def test_metrics_equal_those_of_the_service() -> None:
    exposition, _ = create_app(Settings()).state.metrics.exposition("")
    samples = set(re.findall(r"^# TYPE (hof_\w+) ", exposition.decode(), re.MULTILINE))
    documented = {cells[0].strip("`") for cells in rows(section(text_of("docs/operations.md"), "Metrics"))}
    assert documented == {name for name in samples if not name.endswith("_created")}


@pytest.mark.parametrize("quote", QUOTES, ids=lambda quote: quote.heading)
def test_figures_equal_the_report(quote: Quote) -> None:
    quoted = rows(section(text_of(quote.document), quote.heading))
    measured = rows("|-|\n" + "\n".join(measured_rows(quote).values()))
    assert len(quoted) >= 5
    assert [row for row in quoted if row not in measured] == []


def test_needs_of_capacity_follow_from_the_reports() -> None:
    text = text_of(capacity.DOCUMENT)
    assert text == capacity.updated(text), "run python -m tests.project.quoted_figures"
