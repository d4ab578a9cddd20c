"""POST /compose: new objects made of stored ones."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Final

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.admission import needs_gate
from service.api.context import client_of
from service.api.dependencies import ReadyRuntime
from service.api.queries import Composition, NoQuery
from service.api.responses.errors import BODY_STALLED, OVERLOADED, Problem, Responses
from service.api.responses.objects import ComposedObjects, StoredObject
from service.api.wire.disconnects import while_connected
from service.api.wire.json_bodies import read_json
from service.errors import NotFound
from service.formats.rounding import StoreDtype, rounded
from service.mapping.box import PROBE_POINTS
from service.mapping.spec import Functions
from service.runtime.composition import Proposal, check_records, examine_all, propose, with_functions
from service.runtime.cost import check_cost, cost_of
from service.runtime.parts import Runtime
from service.storage.ids import is_id
from service.storage.rows import Record

router = APIRouter()

MAX_BODY_BYTES: Final = 16_384
REQUEST_BODY: Final = {"required": True, "content": {"application/json": {"schema": Composition.model_json_schema()}}}
RESPONSES: Final[Responses] = {
    200: {"description": "The objects that the same call made before"},
    201: {
        "model": StoredObject | ComposedObjects,
        "description": "A new object; with `all` its objects, of which at least one is new",
        "headers": {"Location": {"description": "path of the one object", "schema": {"type": "string"}}},
    },
    400: {"model": Problem, "description": "The body is not JSON"},
    404: {"model": Problem, "description": "No object of an id; `errors` names its place in the body"},
    408: BODY_STALLED,
    413: {"model": Problem, "description": "More bytes than such a call can need"},
    422: {
        "model": Problem,
        "description": "A word of the wrong length, objects of different specs, a composed object among them; "
        "`errors` names the place in the body",
    },
    507: {"model": Problem, "description": "The store has no space left; no object of the call is kept"},
    429: OVERLOADED,
}


@router.post(
    "/compose",
    tags=["objects"],
    response_model=StoredObject | ComposedObjects,
    responses=RESPONSES,
    openapi_extra={"requestBody": REQUEST_BODY},
)
@needs_gate("points")
async def compose(
    request: Request, response: Response, query: Annotated[NoQuery, Query()], runtime: ReadyRuntime
) -> StoredObject | ComposedObjects:
    """Make a composed object, which is kept as its word, or an interpolated one, which has a theta of its own.

    Ids are digests of the mode and the word: a repeat answers 200 with the same objects.
    """
    composition = await read_json(request, Composition, MAX_BODY_BYTES)
    members = await _members(runtime, composition)
    proposed = propose(members, composition.mode)
    records = await runtime.store.records([record.id for record in proposed])
    fresh = [record for record in proposed if record.id not in records]
    any_new = False
    if fresh:
        kept, any_new = await _make(request, runtime, members, fresh)
        records |= {record.id: record for record in kept}
    if any_new:
        response.status_code = 201
    objects = [StoredObject.of(records[record.id], runtime.settings.root_path) for record in proposed]
    if composition.mode == "all":
        return ComposedObjects(objects=objects)
    if any_new:
        response.headers["Location"] = objects[0].links.self_
    return objects[0]


async def _members(runtime: Runtime, composition: Composition) -> list[Record]:
    """Return the records of the objects that the body names.

    Raises
    ------
    NotFound : an object does not exist; the error names the first one.
    InvalidParameter : the objects make no function.
    """
    ids = composition.objects
    records = await runtime.store.records([object_id for object_id in ids if is_id(object_id)])
    for index, object_id in enumerate(ids):
        if object_id not in records:
            raise NotFound(f"objects[{index}]: no object has the id {object_id!r}", field=f"objects[{index}]")
    members = [records[object_id] for object_id in ids]
    check_records(members, composition.mode)
    return members


async def _make(
    request: Request, runtime: Runtime, members: Sequence[Record], fresh: Sequence[Record]
) -> tuple[list[Record], bool]:
    """Keep the objects that are not stored yet; return the records that are kept, and whether any is new.

    The work is admitted before any function is read. Objects that cannot be sampled are refused before any is kept.
    """
    cost = cost_of(members[0].spec, [record.color_spec for record in members if record.color_spec])
    n = PROBE_POINTS * len(fresh)
    check_cost(n, cost, runtime.settings.max_points, "objects")
    with runtime.gates.points.admit(max(n, PROBE_POINTS * len(members)) * cost, client_of(request.scope)):
        functions = {object_id: (await runtime.store.get(object_id))[1] for object_id in {each.id for each in members}}
        dtype = runtime.settings.store_dtype
        proposals = await while_connected(request, runtime.run(_examine_fresh, fresh, functions, dtype))
        return await runtime.store.put_all([(proposal.record, proposal.own) for proposal in proposals])


def _examine_fresh(fresh: Sequence[Record], functions: Mapping[str, Functions], dtype: StoreDtype) -> list[Proposal]:
    """Return the new objects with their functions and frames. Raises InvalidParameter if points exceed float32."""
    proposals = [with_functions(record, functions) for record in fresh]
    return examine_all(
        [replace(each, own=rounded(each.record.spec, each.own, dtype)) if each.own else each for each in proposals]
    )
