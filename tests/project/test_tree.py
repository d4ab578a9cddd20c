"""The tree stays easy to enter: small folders, files and functions, and docstrings that say what they describe."""

import ast
import functools
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest

from tests.support import ROOT

MOST_ENTRIES = 16  # of a folder, `__init__.py` aside
MOST_LINES = 300  # of a Python file
MOST_FUNCTION_LINES = 40  # its docstring and its signature aside
HEADLESS = ("What ", "Which ", "Whether ", "Those ", "Where ", "How ", "All that ", "As `")
PARTICIPLES = frozenset({"found", "told", "asked", "known", "made", "seen", "given", "tried"})
Definition = ast.FunctionDef | ast.AsyncFunctionDef


def _tracked(*patterns: str) -> list[Path]:
    """Return the files of the repository, or the new ones beside them, that match."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *patterns]
    lines = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    return [Path(line) for line in lines if (ROOT / line).exists()]


@functools.cache
def _trees() -> list[tuple[Path, ast.Module]]:
    return [(path, ast.parse((ROOT / path).read_text("utf-8"))) for path in _tracked("*.py")]


def _code_lines(function: Definition) -> int:
    """Return the lines of a function's body, without its docstring."""
    first = function.body[0]
    body = function.body[1:] if ast.get_docstring(function) else function.body
    begin = body[0].lineno if body else first.lineno
    return (function.end_lineno or begin) - begin + 1


def test_folder_has_few_entries() -> None:
    entries: dict[Path, set[str]] = defaultdict(set)
    for path in _tracked("*"):
        for folder, name in zip(path.parents, path.parts[::-1], strict=True):
            if name != "__init__.py":
                entries[folder].add(name)
    entries.pop(Path())  # the root: tools and hosting sites look for their files there
    full = {str(folder): len(names) for folder, names in entries.items() if len(names) > MOST_ENTRIES}
    assert full == {}


def test_files_and_functions_are_short() -> None:
    files = {str(path): count for path, _ in _trees() if (count := _lines(path)) > MOST_LINES}
    assert files == {}
    functions = {
        f"{path}:{node.name}": count
        for path, tree in _trees()
        for node in ast.walk(tree)
        if isinstance(node, Definition) and (count := _code_lines(node)) > MOST_FUNCTION_LINES
    }
    assert functions == {}


def _lines(path: Path) -> int:
    return (ROOT / path).read_text("utf-8").count("\n")


def test_docstrings_begin_with_what_they_describe() -> None:
    headless = [
        f"{path}: {docstring.splitlines()[0]}"
        for path, tree in _trees()
        for node in ast.walk(tree)
        if isinstance(node, Definition | ast.ClassDef | ast.Module)
        and (docstring := ast.get_docstring(node))
        and docstring.startswith(HEADLESS)
    ]
    assert headless == []


def test_values_are_named_by_nouns() -> None:
    named = {
        f"{path}:{name.lineno}: {name.id}"
        for path, tree in _trees()
        for function in ast.walk(tree)
        if isinstance(function, Definition)  # a field of an options class is a flag, such as `--made`
        for name in ast.walk(function)
        if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store) and name.id in PARTICIPLES
    }
    assert named == set()


@pytest.mark.parametrize(
    ("source", "count"), [("def f():\n    '''Do.'''\n    a = 1\n    return a\n", 2), ("def f(): ...\n", 1)]
)
def test_code_lines_leave_out_the_docstring(source: str, count: int) -> None:
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    assert _code_lines(function) == count
