"""Labels of objects: names that people give them."""

import re
from typing import Final

from service.errors import InvalidParameter

MAX_LABEL: Final = 80  # characters
ONE_LINE: Final = r"^[^\u0000-\u001f\u007f-\u009f\u2028\u2029]*$"  # no control characters, no line breaks
LABEL_SCHEMA: Final[dict[str, int | str]] = {"maxLength": MAX_LABEL, "pattern": ONE_LINE}


def clean_label(text: str) -> str | None:
    """Return a label without spaces around it; None for an empty one.

    Every label that this returns can be stored, and written to a weights file and read back.

    Raises
    ------
    InvalidParameter : more than `MAX_LABEL` characters, line breaks, control characters, or half a surrogate pair.
    """
    if len(text) > MAX_LABEL:
        raise InvalidParameter(f"the label has {len(text)} characters, the limit is {MAX_LABEL}", field="label")
    if not re.fullmatch(ONE_LINE, text):
        raise InvalidParameter("the label has line breaks or control characters; send one line", field="label")
    if any("\ud800" <= character <= "\udfff" for character in text):  # no encoding has them
        raise InvalidParameter("the label is not valid Unicode: it has half a surrogate pair", field="label")
    return text.strip() or None
