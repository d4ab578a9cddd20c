"""Copy measured figures into the documents that quote them: `python -m tests.project.quoted_figures`.

The needs in docs/capacity.md are computed from them (`tests.project.capacity`).
"""

from typing import Final, NamedTuple

from tests.project.documents import ROOT, section, text_of


class Quote(NamedTuple):
    """A table of a document that repeats rows of a report.

    Attributes
    ----------
    document, heading : the document, and the section with the table.
    report : file in benchmarks/.
    report_heading : the report's section with the rows; None for what stands above its first section.
    """

    document: str
    heading: str
    report: str
    report_heading: str | None


QUOTES: Final = (
    Quote("README.md", "Performance", "RESULTS.md", "HOF-1, k = 2: Mpoints/s, one core"),
    Quote("docs/api.md", "Size", "BOXES.md", None),
    Quote("docs/capacity.md", "Photos", "LOAD.md", "POST /encode beside others"),
    Quote("docs/capacity.md", "Points", "RESULTS.md", "HOF-1, k = 2: Mpoints/s, one core"),
    Quote("docs/performance.md", "Points", "RESULTS.md", "HOF-1, k = 1: Mpoints/s, one core"),
    Quote("docs/performance.md", "Against other decoders, and over HTTP", "RESULTS.md", None),
    Quote("docs/performance.md", "HOF-3 and tanh beside other methods", "RESULTS.md", None),
    Quote("docs/performance.md", "The web page", "PAGE.md", None),
    Quote("docs/performance.md", "Under overload", "LOAD.md", None),
)


def measured_rows(quote: Quote) -> dict[str, str]:
    """Return the rows of the report, by their first cell."""
    text = text_of(f"benchmarks/{quote.report}")
    part = section(text, quote.report_heading) if quote.report_heading else text.partition("\n## ")[0]
    return {_name(line): line for line in part.splitlines() if line.startswith("|")}


def updated(quote: Quote, text: str) -> str:
    """Return the document with the quoted rows as the report has them. Raises ValueError if the heading is missing."""
    rows, old = measured_rows(quote), section(text, quote.heading)
    new = "\n".join(rows.get(_name(line), line) if line.startswith("|") else line for line in old.split("\n"))
    return text.replace(old, new)


def _name(row: str) -> str:
    return row.split("|")[1].strip()


if __name__ == "__main__":
    for each in QUOTES:
        (ROOT / each.document).write_text(updated(each, text_of(each.document)), "utf-8")
    from tests.project import capacity  # which imports this module

    (ROOT / capacity.DOCUMENT).write_text(capacity.updated(text_of(capacity.DOCUMENT)), "utf-8")
