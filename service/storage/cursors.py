"""Cursors of the list of objects: where its next page begins."""

import base64
from typing import Final

from service.errors import InvalidParameter

MAX_SEQ: Final = 2**63 - 1


def encode_cursor(seq: int) -> str:
    """Return the cursor of the page after the object with this `seq`."""
    return base64.urlsafe_b64encode(str(seq).encode()).decode().rstrip("=")


def decode_cursor(cursor: str) -> int:
    """Return the `seq` that a cursor stands for. Raises InvalidParameter if no page returned it."""
    try:
        text = base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4))
        seq = int(text)
    except ValueError as error:
        raise InvalidParameter("the cursor did not come from a page of objects", field="cursor") from error
    if not 1 <= seq <= MAX_SEQ or encode_cursor(seq) != cursor:
        raise InvalidParameter("the cursor did not come from a page of objects", field="cursor")
    return seq
