"""Calls as values: the request and the reading of its answer. They know no HTTP client and neither block nor wait."""

from collections.abc import Callable, Mapping, Sized
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar
from urllib.parse import quote

from hof_client.bodies import Reader

T = TypeVar("T")
SizedT = TypeVar("SizedT", bound=Sized)
T_co = TypeVar("T_co", covariant=True)
Value = str | int | float | bool | None


class Chunks(Protocol[T_co]):
    """A body that is passed on piece by piece."""

    def feed(self, data: bytes) -> T_co:
        """Return what the next bytes complete. Raises UnexpectedAnswer."""

    def end(self) -> None:
        """Raise Truncated unless the body is complete."""


@dataclass(frozen=True)
class Request:
    """A request.

    Attributes
    ----------
    method, template : the operation, as openapi.json names it.
    places : values of the template's placeholders.
    query : parameters; those of the value None are not sent.
    content : the body.
    media_type : of the answer; "" for any.
    is_repeatable : whether a repeat has the same effect and the same answer.
    """

    method: str
    template: str
    places: Mapping[str, str] = field(default_factory=dict)
    query: Mapping[str, Value] = field(default_factory=dict)
    content: bytes | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    media_type: str = "application/json"
    is_repeatable: bool = True

    @property
    def path(self) -> str:
        """The path from the service's root. Raises ValueError for a value that cannot be a part of a path."""
        return self.template.format_map({name: _part(name, value) for name, value in self.places.items()})

    @property
    def parameters(self) -> dict[str, str]:
        """The query's parameters as they are sent."""
        values = {name: value for name, value in self.query.items() if value is not None}
        return {name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in values.items()}


@dataclass(frozen=True)
class Call(Generic[T]):
    """A request and the reader of its answer, made from the answer's headers."""

    request: Request
    read: Callable[[Mapping[str, str]], Reader[T]]


@dataclass(frozen=True)
class Stream(Generic[SizedT]):
    """A request whose answer is passed on piece by piece."""

    request: Request
    chunks: Callable[[], Chunks[SizedT]]


def _part(name: str, value: str) -> str:
    if value in ("", ".", ".."):
        raise ValueError(f"{name} is {value!r}, which names nothing")
    return quote(value, safe="")
