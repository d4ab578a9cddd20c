"""The stored objects, and what each gives: points and weights."""

from datetime import UTC, datetime
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Path, Query
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from service.caching import CACHE_CONTROL, accepts_gzip, etag, is_fresh
from service.errors import InvalidParameter, NotFound
from service.formats import POINT_FORMATS, negotiate
from service.formats.weights import WEIGHT_FORMATS, Weights, dump, load
from service.ids import imported_id, is_id
from service.mapping import word_of
from service.points import check_finite, check_size, gzipped, stream
from service.queries import NoQuery, PageQuery, PointsQuery, WeightsQuery
from service.runtime import Ready
from service.schemas import ObjectPage, Problem, StoredObject
from service.store import Record
from service.uploads import read_body

router = APIRouter(prefix="/objects", tags=["objects"])
BINARY: Final = {"schema": {"type": "string", "format": "binary"}}
FILE_HEADERS: Final = {
    "Content-Disposition": {"description": "a file name", "schema": {"type": "string"}},
    "ETag": {"description": "weak: of the object, the parameters and the version", "schema": {"type": "string"}},
    "Cache-Control": {"description": "an object never changes", "schema": {"type": "string"}},
}
NOT_MODIFIED: Final[dict[int | str, dict[str, Any]]] = {304: {"description": "`If-None-Match` names this very answer"}}
MISSING: Final[dict[int | str, dict[str, Any]]] = {404: {"model": Problem, "description": "No object of that id"}}


def object_id(id_: Annotated[str, Path(alias="id", description="id of an object")]) -> str:
    """The id of the path. Raises NotFound for what cannot be one, before a database has to make sense of it."""
    if not is_id(id_):
        raise NotFound("there is no object of this id")
    return id_


ObjectId = Annotated[str, Depends(object_id)]


@router.get("")
async def page_of_objects(query: Annotated[PageQuery, Query()], runtime: Ready) -> ObjectPage:
    """The stored objects, newest first. Objects that come in meanwhile do not shift the pages."""
    records, cursor = await runtime.store.page(query.limit, query.cursor)
    return ObjectPage(items=[StoredObject.of(record) for record in records], next=cursor, limit=query.limit)


@router.post(
    "",
    response_model=StoredObject,
    responses={
        200: {"description": "The object that the same weights gave before"},
        201: {
            "model": StoredObject,
            "description": "A new object",
            "headers": {"Location": {"description": "path of the object", "schema": {"type": "string"}}},
        },
        400: {"model": Problem, "description": "Bytes that are no weights file, or whose numbers do not fit its spec"},
        413: {"model": Problem, "description": "More bytes than the limit"},
        422: {
            "model": Problem,
            "description": "A spec that describes no function; a composed object's file; an unknown parameter",
        },
    },
    openapi_extra={"requestBody": {"required": True, "content": {"application/octet-stream": BINARY}}},
)
async def import_object(
    request: Request, response: Response, query: Annotated[NoQuery, Query()], runtime: Ready
) -> StoredObject:
    """Keep a weights file (safetensors with its spec, as `/objects/{id}/weights` gives it) as an object.

    The file of a composed object is refused: an object is one function. Post those of its word, and compose them.
    """
    body = await read_body(request, runtime.settings.max_weights_bytes)
    weights = await runtime.run(_finite_weights, body)
    record, created = await runtime.store.put(
        Record(imported_id(weights.spec, weights.theta), "imported", weights.model, weights.spec, datetime.now(UTC)),
        weights.theta,
    )
    if created:
        response.status_code = 201
        response.headers["Location"] = f"/objects/{record.id}"
    return StoredObject.of(record)


@router.get("/{id}", responses=MISSING)
async def one_object(id_: ObjectId, query: Annotated[NoQuery, Query()], runtime: Ready) -> StoredObject:
    """One object."""
    record, _ = await runtime.store.get(id_)
    return StoredObject.of(record)


@router.delete(
    "/{id}",
    status_code=204,
    responses=MISSING | {409: {"model": Problem, "description": "Composed objects, which `detail` names, use it"}},
)
async def delete_object(id_: ObjectId, query: Annotated[NoQuery, Query()], runtime: Ready) -> None:
    """Remove an object, unless the word of a composed object names it. Interpolated objects outlive their parents."""
    await runtime.store.delete(id_)


@router.get(
    "/{id}/points",
    response_class=StreamingResponse,
    responses=MISSING
    | NOT_MODIFIED
    | {
        200: {
            "description": "The points, streamed",
            "content": {fmt.media_type: BINARY for fmt in POINT_FORMATS.values()},
            "headers": FILE_HEADERS,
        },
        406: {"model": Problem, "description": "No format satisfies `Accept`"},
    },
)
async def points(request: Request, id_: ObjectId, query: Annotated[PointsQuery, Query()], runtime: Ready) -> Response:
    """Sample the object: canonical points through f^k, in the object frame (+Y up, front +Z, longest side 1).

    The first m points of n are the points of m; `offset` goes on where another call stopped.
    """
    accept = request.headers.get("accept")
    fmt = POINT_FORMATS[query.format] if query.format else negotiate(accept, POINT_FORMATS.values())
    check_size(fmt, query.n, runtime.settings.max_points)
    record, theta = await runtime.store.get(id_)
    cloud = query.cloud(record.spec, theta)
    squeezed = fmt.is_text and accepts_gzip(request.headers.get("accept-encoding"))
    tag = etag(id_, fmt.name, query.model_dump(exclude={"format"}), squeezed)
    headers = cached(tag) | {"Vary": "Accept, Accept-Encoding"}
    if is_fresh(request.headers.get("if-none-match"), tag):
        return Response(status_code=304, headers=headers)
    headers |= attachment(id_, fmt.extension)
    length = fmt.length(query.n)
    if length is not None:
        headers["Content-Length"] = str(length)
    if squeezed:
        headers["Content-Encoding"] = "gzip"
    if "hof.head" in request.scope:
        return Response(headers=headers, media_type=fmt.media_type)
    pieces = stream(fmt, cloud, runtime.run, ahead=runtime.settings.threads)
    if squeezed:
        pieces = gzipped(pieces, runtime.run)
    return StreamingResponse(pieces, headers=headers, media_type=fmt.media_type)


@router.get(
    "/{id}/weights",
    response_class=Response,
    responses=MISSING
    | NOT_MODIFIED
    | {
        200: {
            "description": "theta in the chosen format",
            "content": {fmt.media_type: BINARY for fmt in WEIGHT_FORMATS.values()},
            "headers": FILE_HEADERS,
        }
    },
)
async def weights(request: Request, id_: ObjectId, query: Annotated[WeightsQuery, Query()], runtime: Ready) -> Response:
    """theta and its spec: all that is needed to sample the object elsewhere. A composed object has k, and its word.

    An ONNX file holds them as one function, x -> points, which runs anywhere.
    """
    record, theta = await runtime.store.get(id_)
    headers = cached(etag(id_, query.format))
    if is_fresh(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    word = record.members if record.kind == "composed" else ()
    data = await runtime.run(dump, Weights(record.spec, theta, record.model, word), query.format)
    fmt = WEIGHT_FORMATS[query.format]
    return Response(data, headers=headers | attachment(id_, fmt.extension), media_type=fmt.media_type)


def cached(tag: str) -> dict[str, str]:
    """Headers of an answer that may be kept."""
    return {"ETag": tag, "Cache-Control": CACHE_CONTROL}


def attachment(id_: str, extension: str) -> dict[str, str]:
    """The header that names the file."""
    return {"Content-Disposition": f'attachment; filename="hof-{id_}{extension}"'}


def _finite_weights(body: bytes) -> Weights:
    """The weights of one function's file. Raises CorruptWeights, also where f^k leaves the range of float32."""
    weights = load(body)
    if weights.word:
        raise InvalidParameter("this file is a composed object's: post the files of its word, and compose them")
    check_finite(weights.spec, word_of(weights.spec, weights.theta))
    return weights
