"""What the answers that are files share: an object's points, weights and surface."""

from collections.abc import Iterable
from typing import Annotated, Any, Final, Protocol

from fastapi import Depends, Path, Response

from service.api.responses import OVERLOADED, Problem
from service.api.wire.caching import CACHE_CONTROL
from service.errors import NotFound
from service.storage.ids import is_id

Responses = dict[int | str, dict[str, Any]]

BINARY: Final = {"schema": {"type": "string", "format": "binary"}}
JSON: Final = {"schema": {"type": "object"}}
MISSING: Final[Responses] = {404: {"model": Problem, "description": "No object of that id"}}
NOT_ACCEPTABLE: Final[Responses] = {406: {"model": Problem, "description": "No format satisfies `Accept`"}}


class _Format(Protocol):
    @property
    def media_type(self) -> str: ...


def file_responses(description: str, formats: Iterable[_Format]) -> Responses:
    """What is told of a call that answers with an object's file, in one of some formats."""
    headers = {
        "Content-Disposition": {"description": "a file name", "schema": {"type": "string"}},
        "ETag": {"description": "weak: of the object, the parameters and the version", "schema": {"type": "string"}},
        "Cache-Control": {"description": "an object never changes", "schema": {"type": "string"}},
    }
    content = {fmt.media_type: JSON if fmt.media_type.endswith("json") else BINARY for fmt in formats}
    return {
        **MISSING,
        304: {"description": "`If-None-Match` names this very answer"},
        200: {"description": description, "content": content, "headers": headers},
        429: OVERLOADED,
    }


async def object_id(id_: Annotated[str, Path(alias="id", description="id of an object")]) -> str:
    """The id of the path. Raises NotFound for what cannot be one, before a database has to make sense of it."""
    if not is_id(id_):
        raise NotFound("there is no object of this id")
    return id_


ObjectId = Annotated[str, Depends(object_id)]


def cached(tag: str) -> dict[str, str]:
    """Headers of an answer that may be kept."""
    return {"ETag": tag, "Cache-Control": CACHE_CONTROL}


def attachment(id_: str, extension: str) -> dict[str, str]:
    """The header that names the file."""
    return {"Content-Disposition": f'attachment; filename="hof-{id_}{extension}"'}


def head(headers: dict[str, str], media_type: str) -> Response:
    """What HEAD answers for a file that nobody makes: without a Content-Length if `headers` has none."""
    answer = Response(headers=headers, media_type=media_type)
    if "Content-Length" not in headers:
        del answer.headers["Content-Length"]  # of the empty body
    return answer
