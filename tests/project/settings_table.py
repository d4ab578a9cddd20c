"""Write the rows of the settings tables in the documents: `python -m tests.project.settings_table`."""

import re
from pathlib import Path
from typing import Final

from service.settings import Settings

ROOT: Final = Path(__file__).parents[2]
DOCUMENTS: Final = (ROOT / "docs" / "operations.md", ROOT / "SECURITY.md")
ROW: Final = re.compile(r"^\| `--([a-z-]+)` \|.*$", re.MULTILINE)


def row(name: str) -> str:
    """Return the table row of one setting: flag, variable, default, purpose."""
    field = Settings.model_fields[name]
    purpose, _, default = str(field.description).partition("; default: ")
    default = default or ("none" if field.default is None else f"`{field.default}`")
    return f"| `--{name.replace('_', '-')}` | `HOF_{name.upper()}` | {default} | {purpose} |"


def names(text: str) -> list[str]:
    """Return the settings that a document's tables have a row for, in order."""
    return [flag.replace("-", "_") for flag in ROW.findall(text)]


def rewrite(text: str) -> str:
    """Replace each row by the one that the code gives. Raises KeyError for a flag that does not exist."""
    return ROW.sub(lambda match: row(match[1].replace("-", "_")), text)


if __name__ == "__main__":
    for document in DOCUMENTS:
        document.write_text(rewrite(document.read_text("utf-8")), "utf-8")
