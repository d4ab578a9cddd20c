"""Labels of objects: names that people give them."""

import unicodedata
from typing import Final

from service.errors import InvalidParameter

MAX_LABEL: Final = 80  # characters
REFUSED: Final = ("Cc", "Cs", "Zl", "Zp")  # Unicode categories: control characters, surrogates, line breaks


def clean_label(text: str) -> str | None:
    """Return a label without spaces around it; None for an empty one. Raises InvalidParameter."""
    label = text.strip()
    if len(label) > MAX_LABEL:
        raise InvalidParameter(f"the label has {len(label)} characters, the limit is {MAX_LABEL}", field="label")
    if any(unicodedata.category(character) in REFUSED for character in label):
        raise InvalidParameter("the label has line breaks or control characters; send one line", field="label")
    return label or None
