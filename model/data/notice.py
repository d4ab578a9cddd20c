"""Credits of the objects that a model was trained on, for NOTICE."""

from collections.abc import Iterable

from model.data.manifest import Entry


def notice(entries: Iterable[Entry]) -> str:
    """Return a paragraph for each source and license, with title, author and page of each object.

    An object without author says so: a license such as CC BY asks for the name.
    """
    groups: dict[tuple[str, str], set[tuple[str, str]]] = {}
    for entry in entries:
        groups.setdefault((entry.source, entry.license), set()).add((entry.creator.casefold(), _credit(entry)))
    paragraphs = []
    for (source, license_), credits_ in sorted(groups.items()):
        lines = "".join(f"    {credit}\n" for _, credit in sorted(credits_))
        paragraphs.append(f"{source}: {license_}\n\n{lines}")
    return "\n".join(paragraphs)


def _credit(entry: Entry) -> str:
    author = "author unknown" if entry.creator == "unknown" else f"by {entry.creator}"
    separator = ", " if entry.creator == "unknown" else " "
    return f'"{entry.name}"{separator}{author}' + (f" ({entry.page})" if entry.page else "")
