"""POST /compose: new objects made of stored ones."""

from collections.abc import Sequence
from typing import Annotated, Final

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.admission import needs_gate
from service.api.dependencies import ReadyRuntime
from service.api.queries import Composition, NoQuery
from service.api.responses import BODY_STALLED, OVERLOADED, ComposedObjects, Problem, Responses, StoredObject
from service.api.wire.disconnects import while_connected
from service.api.wire.json_bodies import read_json
from service.errors import NotFound
from service.mapping.box import PROBE_POINTS
from service.mapping.spec import Functions
from service.runtime.composition import Proposal, check_records, examined, propose
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
    cost = cost_of(members[0][0].spec, *(functions for _, functions in members))
    with runtime.gates.points.admit(PROBE_POINTS * len(members) * cost):
        proposals = await while_connected(request, runtime.run(propose, members, composition.mode))
    records, any_new = await _keep(request, runtime, proposals, cost)
    if any_new:
        response.status_code = 201
    objects = [StoredObject.of(record, runtime.settings.root_path) for record in records]
    if composition.mode == "all":
        return ComposedObjects(objects=objects)
    if any_new:
        response.headers["Location"] = objects[0].links.self_
    return objects[0]


async def _members(runtime: Runtime, composition: Composition) -> list[tuple[Record, Functions]]:
    """Return the objects that the body names, each with its functions.

    Functions are read once for each object, and only after all records were found to go together.

    Raises
    ------
    NotFound : an object does not exist; the error names the first one.
    InvalidParameter : the objects make no function.
    """
    ids = composition.objects
    records = await runtime.store.records([object_id for object_id in ids if is_id(object_id)])
    for index, object_id in enumerate(ids):
        if object_id not in records:
            raise NotFound(f"objects[{index}]: there is no object of this id", field=f"objects[{index}]")
    check_records([records[object_id] for object_id in ids], composition.mode)
    members = {object_id: await runtime.store.get(object_id) for object_id in dict.fromkeys(ids)}
    return [members[object_id] for object_id in ids]


async def _keep(
    request: Request, runtime: Runtime, proposals: Sequence[Proposal], cost: int
) -> tuple[list[Record], bool]:
    """Keep the proposed objects; return their records, and whether any is new.

    Objects that cannot be sampled are refused before any is kept. `cost` is that of a point of each object.
    """
    kept = await runtime.store.records([proposal.record.id for proposal in proposals])
    fresh = [proposal for proposal in proposals if proposal.record.id not in kept]
    if not fresh:
        return [kept[proposal.record.id] for proposal in proposals], False
    n = PROBE_POINTS * len(fresh)
    check_cost(n, cost, runtime.settings.max_points, "objects")
    with runtime.gates.points.admit(n * cost):
        measured = await while_connected(request, runtime.run(examined, fresh))
    records = {proposal.record.id: proposal.record for proposal in measured}
    pairs = [(records.get(proposal.record.id, proposal.record), proposal.own) for proposal in proposals]
    return await runtime.store.put_all(pairs)
