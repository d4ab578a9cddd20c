"""POST /objects: a weights file becomes an object."""

from datetime import UTC, datetime
from typing import Annotated, Final

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.admission import needs_gate
from service.api.context import client_of
from service.api.dependencies import ReadyRuntime
from service.api.queries import NoQuery
from service.api.responses.errors import BINARY, BODY_STALLED, NO_SPACE, OBJECT_LOCATION, OVERLOADED, Problem, Responses
from service.api.responses.objects import StoredObject
from service.api.wire.disconnects import while_connected
from service.api.wire.uploads import read_body
from service.errors import InvalidParameter
from service.formats.rounding import StoreDtype, rounded
from service.formats.weights import Weights, load
from service.mapping.box import PROBE_POINTS, examine
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.runtime.cost import cost_of
from service.runtime.frames import complete_record
from service.storage.ids import imported_id
from service.storage.rows import Details, Record

router = APIRouter(prefix="/objects", tags=["objects"])

RESPONSES: Final[Responses] = {
    200: {"description": "The object that the same weights gave before; it takes the file's label if it has none"},
    201: {"model": StoredObject, "description": "A new object", "headers": OBJECT_LOCATION},
    400: {"model": Problem, "description": "Not a weights file, or its numbers do not fit its spec"},
    408: BODY_STALLED,
    413: {"model": Problem, "description": "More bytes than the limit"},
    422: {
        "model": Problem,
        "description": "A spec that describes no function; a composed object's file; an unknown parameter",
    },
    507: NO_SPACE,
    429: OVERLOADED,
}


@router.post(
    "",
    response_model=StoredObject,
    responses=RESPONSES,
    openapi_extra={"requestBody": {"required": True, "content": {"application/octet-stream": BINARY}}},
)
@needs_gate("points")
async def import_object(
    request: Request, response: Response, query: Annotated[NoQuery, Query()], runtime: ReadyRuntime
) -> StoredObject:
    """Keep a weights file as an object: safetensors with its spec, as `/objects/{id}/weights` gives it.

    The file of a composed object is refused, because an object is one function: post the files of its word, and
    compose them.
    """
    gates, max_bytes = runtime.gates, runtime.settings.max_weights_bytes
    client = client_of(request.scope)
    with gates.uploads.admit(0, client) as upload:
        body = await read_body(request, max_bytes, upload)
        weights = await while_connected(request, runtime.run(_load_one_function, body))
        spec, functions, color = weights.spec, weights.functions, weights.color
        cost = cost_of(spec, [color.spec] if color else [])
        with gates.points.admit(PROBE_POINTS * cost, client):
            dtype = runtime.settings.store_dtype
            functions, frame = await while_connected(request, runtime.run(_examine, spec, functions, dtype))
        record, is_new = await runtime.store.put(_record(weights, functions, frame), functions)
        record, _ = await complete_record(runtime, record, Details(label=weights.label), client=client)
    answer = StoredObject.of(record, runtime.settings.root_path)
    if is_new:
        response.status_code = 201
        response.headers["Location"] = answer.links.self_
    return answer


def _load_one_function(body: bytes) -> Weights:
    """Return the weights in a file of one function. Raises CorruptWeights, InvalidSpec or InvalidParameter."""
    weights = load(body)
    if weights.word:
        raise InvalidParameter("this file is a composed object's: post the files of its word, and compose them")
    return weights


def _examine(spec: MappingSpec, functions: Functions, dtype: StoreDtype) -> tuple[Functions, Frame]:
    """Return the functions as they are stored, and their frame. Raises CorruptWeights if values exceed float32."""
    kept = rounded(spec, functions, dtype)
    return kept, examine(spec, kept)


def _record(weights: Weights, functions: Functions, frame: Frame) -> Record:
    color_spec = weights.color.spec if weights.color else None
    return Record(
        imported_id(weights.spec, functions),
        "imported",
        weights.model,
        weights.spec,
        datetime.now(UTC),
        color_spec=color_spec,
        frame=frame,
        label=weights.label,
    )
