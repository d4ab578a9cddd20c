"""Objects of a model in colour, and their files: of points and of surfaces alike."""

from typing import Any

import httpx

from tests.support.photos import disc, image_file


def encoded(client: httpx.Client, colour: str = "red") -> dict[str, Any]:
    """The object of a disc's photo."""
    made: dict[str, Any] = client.post("/encode", content=image_file(disc(colour))).json()
    return made


def file_of(client: httpx.Client, made: dict[str, Any], of: str, **query: int | str) -> bytes:
    """A file of the object's `points` or its `mesh`."""
    answer = client.get(made["links"][of], params=query)
    assert answer.status_code == 200, answer.text
    return answer.content


def check_none_leaves_colour_out(
    client: httpx.Client, colored: httpx.Client, of: str, holds_color: bool, **query: int | str
) -> None:
    """`color=none` gives the file of a model without colour, and without it only what holds none gives that."""
    plain, made = encoded(client), encoded(colored)
    expected = file_of(client, plain, of, **query)
    assert expected == file_of(client, plain, of, **query, color="none")
    assert expected == file_of(colored, made, of, **query, color="none")
    assert (file_of(colored, made, of, **query) != expected) == holds_color
