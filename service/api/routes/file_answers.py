"""Answers that are files of an object: its points, its surface, its weights."""

from collections.abc import Callable, Coroutine, Iterable, Mapping
from typing import Any, Final, Protocol, TypeVar

from starlette.requests import Request
from starlette.responses import Response

from service.api.context import context_of
from service.api.responses.errors import BINARY, OBJECT_NOT_FOUND, OVERLOADED, Problem, Responses
from service.api.wire.caching import CACHE_CONTROL, etag, is_fresh
from service.api.wire.disconnects import AdmittedFile
from service.api.wire.negotiation import negotiate
from service.runtime.admission import Gate

JSON: Final = {"schema": {"type": "object"}}
NOT_ACCEPTABLE: Final[Responses] = {406: {"model": Problem, "description": "No format satisfies `Accept`"}}


class FileFormat(Protocol):
    """A file format as HTTP needs to know it."""

    @property
    def media_type(self) -> str:
        """The media type, as in Content-Type."""

    @property
    def extension(self) -> str:
        """The extension of a file's name, with its dot."""


Format = TypeVar("Format", bound=FileFormat)


def file_responses(description: str, formats: Iterable[FileFormat]) -> Responses:
    """Return the OpenAPI responses of a call that answers with a file in one of the formats."""
    headers = {
        "Content-Disposition": {"description": "a file name", "schema": {"type": "string"}},
        "ETag": {"description": "weak: of the object, the parameters and the version", "schema": {"type": "string"}},
        "Cache-Control": {"description": "an object never changes", "schema": {"type": "string"}},
    }
    content = {fmt.media_type: JSON if fmt.media_type.endswith("json") else BINARY for fmt in formats}
    return {
        **OBJECT_NOT_FOUND,
        304: {"description": "`If-None-Match` names this very answer"},
        200: {"description": description, "content": content, "headers": headers},
        429: OVERLOADED,
    }


def format_of(request: Request, name: str | None, formats: Mapping[str, Format]) -> Format:
    """Return the format that the query names, otherwise the one that Accept prefers. Raises NotAcceptable."""
    return formats[name] if name else negotiate(request.headers.get("accept"), formats.values())


class FileAnswer:
    """Head of an answer that is an object's file, known before any of the file is computed.

    Parameters
    ----------
    object_id, fmt : the object and the file's format.
    tagged : values that determine the file's bytes, besides the object's id and the version.
    vary : request headers that the choice of the file depends on; "" for none.
    length : bytes of the body; None if only the computed file tells.
    is_gzipped : whether the body is compressed.

    Attributes
    ----------
    headers, media_type : of the answer with the file.
    """

    def __init__(
        self,
        object_id: str,
        fmt: FileFormat,
        *tagged: object,
        vary: str = "",
        length: int | None = None,
        is_gzipped: bool = False,
    ) -> None:
        self.media_type: Final = fmt.media_type
        self._caching = {"ETag": etag(object_id, *tagged), "Cache-Control": CACHE_CONTROL}
        if vary:
            self._caching["Vary"] = vary
        self.headers: Final[dict[str, str]] = {
            **self._caching,
            "Content-Disposition": f'attachment; filename="hof-{object_id}{fmt.extension}"',
        }
        if length is not None:
            self.headers["Content-Length"] = str(length)
        if is_gzipped:
            self.headers["Content-Encoding"] = "gzip"

    def without_file(self, request: Request) -> Response | None:
        """Return the answer to a request that needs no file computed: 304 or HEAD; None if it needs the file."""
        if is_fresh(request.headers.get("if-none-match"), self.headers["ETag"]):
            return Response(status_code=304, headers=self._caching)
        if not context_of(request.scope).is_head:
            return None
        response = Response(headers=self.headers, media_type=self.media_type)
        if "Content-Length" not in self.headers:
            del response.headers["Content-Length"]  # Starlette's, of the empty body
        return response

    def with_file(self, compute: Callable[[], Coroutine[Any, Any, bytes]], gate: Gate, amount: int) -> AdmittedFile:
        """Return the answer with the file, which is computed and sent within the gate."""
        return AdmittedFile(compute, gate, amount, self.headers, self.media_type)
