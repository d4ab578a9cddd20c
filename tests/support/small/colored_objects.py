"""Objects of a model with colors, and their files of points and surfaces."""

from typing import Any

import httpx

from tests.support.photos import disc, image_file


def encoded(client: httpx.Client, color: str = "red") -> dict[str, Any]:
    """Return the object encoded from a photo of a disc."""
    stored: dict[str, Any] = client.post("/encode", content=image_file(disc(color))).json()
    return stored


def file_of(client: httpx.Client, stored: dict[str, Any], of: str, **query: int | str) -> bytes:
    """Return a file of the object's `points` or its `mesh`."""
    answer = client.get(stored["links"][of], params=query)
    assert answer.status_code == 200, answer.text
    return answer.content


def check_none_leaves_color_out(
    client: httpx.Client, colored: httpx.Client, of: str, holds_color: bool, **query: int | str
) -> None:
    """Check that `color=none` gives the file of a model without color, and the default another if it holds colors."""
    plain, stored = encoded(client), encoded(colored)
    expected = file_of(client, plain, of, **query)
    assert expected == file_of(client, plain, of, **query, color="none")
    assert expected == file_of(colored, stored, of, **query, color="none")
    assert (file_of(colored, stored, of, **query) != expected) == holds_color
