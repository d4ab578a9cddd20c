"""Labels of objects: names that people give them."""

import re
from typing import Final

from service.errors import InvalidParameter

MAX_LABEL: Final = 80  # characters
ONE_LINE: Final = r"^[^\u0000-\u001f\u007f-\u009f\u2028\u2029]*$"  # no control characters, no line breaks
LABEL_SCHEMA: Final[dict[str, int | str]] = {"maxLength": MAX_LABEL, "pattern": ONE_LINE}


def clean_label(text: str) -> str | None:
    """Return a label without spaces around it; None for an empty one. Raises InvalidParameter."""
    if len(text) > MAX_LABEL:
        raise InvalidParameter(f"the label has {len(text)} characters, the limit is {MAX_LABEL}", field="label")
    if not re.fullmatch(ONE_LINE, text):
        raise InvalidParameter("the label has line breaks or control characters; send one line", field="label")
    return text.strip() or None
