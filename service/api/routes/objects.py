"""The stored objects, and what each gives: points and weights."""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from service.api.queries import NoQuery, PageQuery, PointsQuery, WeightsQuery
from service.api.responses import OVERLOADED, ObjectPage, Problem, StoredObject
from service.api.routes.file_answers import (
    BINARY,
    MISSING,
    NOT_ACCEPTABLE,
    ObjectId,
    attachment,
    cached,
    file_responses,
    head,
)
from service.api.wire.caching import accepts_gzip, etag, is_fresh
from service.api.wire.disconnects import AdmittedStream, while_there
from service.api.wire.negotiation import negotiate
from service.api.wire.uploads import read_body, size_ahead
from service.errors import InvalidParameter
from service.formats.points.registry import POINT_FORMATS
from service.formats.weights import WEIGHT_FORMATS, Weights, dump, load
from service.mapping.cloud import PROBE_POINTS, check_finite
from service.runtime.cost import check_cost, check_size, cost_of, in_flight
from service.runtime.parts import Ready
from service.runtime.shapes import cloud_of
from service.runtime.streaming import gzipped, stream
from service.storage.ids import imported_id
from service.storage.store import Record

router = APIRouter(prefix="/objects", tags=["objects"])


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
        408: {"model": Problem, "description": "The rest of the body does not come"},
        413: {"model": Problem, "description": "More bytes than the limit"},
        422: {
            "model": Problem,
            "description": "A spec that describes no function; a composed object's file; an unknown parameter",
        },
        507: {"model": Problem, "description": "The store has no space left; the object is not kept"},
        429: OVERLOADED,
    },
    openapi_extra={"requestBody": {"required": True, "content": {"application/octet-stream": BINARY}}},
)
async def import_object(
    request: Request, response: Response, query: Annotated[NoQuery, Query()], runtime: Ready
) -> StoredObject:
    """Keep a weights file (safetensors with its spec, as `/objects/{id}/weights` gives it) as an object.

    The file of a composed object is refused: an object is one function. Post those of its word, and compose them.
    """
    gates, max_bytes = runtime.gates, runtime.settings.max_weights_bytes
    with gates.uploads.admit(size_ahead(request, max_bytes)):
        weights = await while_there(request, runtime.run(_one_function, await read_body(request, max_bytes)))
        spec, functions = weights.spec, weights.functions
        with gates.points.admit(PROBE_POINTS * cost_of(spec, functions)):
            await while_there(request, runtime.run(check_finite, spec, functions))
        record, created = await runtime.store.put(_imported(weights), functions)
    if created:
        response.status_code = 201
        response.headers["Location"] = f"/objects/{record.id}"
    return StoredObject.of(record)


@router.get("/{id}", responses=MISSING)
async def one_object(id_: ObjectId, query: Annotated[NoQuery, Query()], runtime: Ready) -> StoredObject:
    """One object."""
    return StoredObject.of(await runtime.store.record(id_))


@router.delete(
    "/{id}",
    status_code=204,
    responses=MISSING
    | {
        409: {"model": Problem, "description": "Composed objects, which `detail` names, use it"},
        507: {"model": Problem, "description": "The store has no space left, not even to remove; the object is kept"},
    },
)
async def delete_object(id_: ObjectId, query: Annotated[NoQuery, Query()], runtime: Ready) -> None:
    """Remove an object, unless the word of a composed object names it. Interpolated objects outlive their parents."""
    await runtime.store.delete(id_)


@router.get(
    "/{id}/points",
    response_class=StreamingResponse,
    responses=file_responses("The points, streamed", POINT_FORMATS.values()) | NOT_ACCEPTABLE,
)
async def points(request: Request, id_: ObjectId, query: Annotated[PointsQuery, Query()], runtime: Ready) -> Response:
    """Sample the object: canonical points through f^k, in the object frame (+Y up, front +Z, longest side 1), each
    with its colour where the object has colours and the format holds them.

    The first m points of n are the points of m; `offset` goes on where another call stopped.
    """
    accept = request.headers.get("accept")
    fmt = POINT_FORMATS[query.format] if query.format else negotiate(accept, POINT_FORMATS.values())
    check_size(fmt, query.n, runtime.settings.max_points)
    record, functions = await runtime.store.get(id_)
    cloud = cloud_of(record.spec, functions, query)
    cost = cost_of(record.spec, cloud.functions)
    check_cost(query.n, cost, runtime.settings.max_points, "n")
    fmt = fmt.holding(color=cloud.functions.color is not None)
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
        return head(headers, fmt.media_type)
    ahead = runtime.settings.threads
    pieces = stream(fmt, cloud, runtime.run, ahead)
    if squeezed:
        pieces = gzipped(pieces, runtime.run)
    amount = cost * in_flight(query.n, ahead)
    return AdmittedStream(pieces, runtime.gates.points, amount, headers, fmt.media_type)


@router.get(
    "/{id}/weights",
    response_class=Response,
    responses=file_responses("theta in the chosen format", WEIGHT_FORMATS.values()),
)
async def weights(request: Request, id_: ObjectId, query: Annotated[WeightsQuery, Query()], runtime: Ready) -> Response:
    """theta and its spec: all that is needed to sample the object elsewhere. A composed object has k, and its word.

    Of an object in colour, safetensors and JSON hold the colour's weights and their spec, too. An ONNX file holds
    thetas as one function, x -> points, which runs anywhere.
    """
    record, functions = await runtime.store.get(id_)
    headers = cached(etag(id_, query.format))
    if is_fresh(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    word = record.members if record.kind == "composed" else ()
    kept = Weights(record.spec, functions.theta, record.model, word, functions.color)
    with runtime.gates.points.admit(PROBE_POINTS * cost_of(record.spec, functions)):
        data = await while_there(request, runtime.run(dump, kept, query.format))
    fmt = WEIGHT_FORMATS[query.format]
    return Response(data, headers=headers | attachment(id_, fmt.extension), media_type=fmt.media_type)


def _one_function(body: bytes) -> Weights:
    """The weights of one function's file. Raises CorruptWeights, InvalidSpec or InvalidParameter."""
    weights = load(body)
    if weights.word:
        raise InvalidParameter("this file is a composed object's: post the files of its word, and compose them")
    return weights


def _imported(weights: Weights) -> Record:
    color_spec = weights.color.spec if weights.color else None
    id_ = imported_id(weights.spec, weights.functions)
    return Record(id_, "imported", weights.model, weights.spec, datetime.now(UTC), color_spec=color_spec)
