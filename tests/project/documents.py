"""The documents and what the tests read from them: links, paths, tables, shell commands."""

import re
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
DOCUMENTS: Final = tuple(
    path
    for pattern in ("*.md", "docs/*.md", "deploy/*.md", "client/*.md", "service/*/README.md", "model/LAB.md")
    for path in sorted(ROOT.glob(pattern))
    if path != ROOT / "RESULTS.md"  # `make results` writes it
)
MODULE: Final = "python3 -m model.cli.main"  # `hof-model` where nothing is installed


def text_of(name: str) -> str:
    """Return the text of a document, named by its path in the project."""
    return (ROOT / name).read_text("utf-8")


def name_of(document: Path) -> str:
    """Return a document's path in the project, for test ids."""
    return document.relative_to(ROOT).as_posix()


def section(text: str, heading: str) -> str:
    """Return what stands under a heading of level 2, up to the next one. Raises ValueError if there is none."""
    before, _, after = text.partition(f"\n## {heading}\n")
    if before == text:
        raise ValueError(f"no heading {heading!r}")
    return after.partition("\n## ")[0]


def rows(text: str) -> list[list[str]]:
    """Return the cells of all table rows, without headers and separator lines."""
    lines = text.splitlines()
    tables = [number for number, line in enumerate(lines) if re.fullmatch(r"(\| ?-+ ?)+\|", line)]
    headers = {number - 1 for number in tables} | set(tables)
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for number, line in enumerate(lines)
        if line.startswith("|") and number not in headers
    ]


def code(text: str) -> list[str]:
    """Return what stands between single backticks, in order."""
    without_blocks = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"`([^`\n]+)`", without_blocks)


def shell_blocks(text: str) -> list[str]:
    """Return the `sh` code blocks, in order."""
    return re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def commands(text: str, program: str | None = None) -> list[str]:
    """Return the lines of all shell blocks, in order; with `program`, those that start with it."""
    blocks = [block.replace("\\\n", " ") for block in shell_blocks(text)]
    lines = [line for block in blocks for line in block.splitlines() if line.strip()]
    lines = [line.replace(MODULE, "hof-model", 1) if line.startswith(MODULE) else line for line in lines]
    return [line for line in lines if program in (None, line.split()[0])]


def anchors(text: str) -> set[str]:
    """Return the anchors that GitHub makes of a document's headings."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
