"""POST /compose: new objects made of stored ones."""

from collections.abc import Sequence
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import Response

from service.api.queries import Composition, NoQuery
from service.api.responses import OVERLOADED, ComposedObjects, Problem, StoredObject
from service.api.wire.disconnects import while_there
from service.api.wire.uploads import read_body
from service.errors import InvalidInput, NotFound
from service.mapping.cloud import PROBE_POINTS
from service.mapping.spec import Functions
from service.runtime.composition import Proposal, check_stored, check_values, propose
from service.runtime.cost import check_cost, cost_of
from service.runtime.parts import Ready, Runtime
from service.storage.ids import is_id
from service.storage.store import Record

router = APIRouter()

MAX_BODY_BYTES: Final = 16_384
REQUEST_BODY: Final = {"required": True, "content": {"application/json": {"schema": Composition.model_json_schema()}}}
RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "What the same call made before"},
    201: {
        "model": StoredObject | ComposedObjects,
        "description": "A new object; with `all` its objects, of which at least one is new",
        "headers": {"Location": {"description": "path of the one object", "schema": {"type": "string"}}},
    },
    400: {"model": Problem, "description": "A body that is no JSON"},
    404: {"model": Problem, "description": "No object of an id; `errors` tells which"},
    408: {"model": Problem, "description": "The rest of the body does not come"},
    413: {"model": Problem, "description": "More bytes than such a call can need"},
    422: {
        "model": Problem,
        "description": "A word of the wrong length, objects of different specs, a composed object among them; "
        "`errors` tells which",
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
async def compose(
    request: Request, response: Response, query: Annotated[NoQuery, Query()], runtime: Ready
) -> StoredObject | ComposedObjects:
    """Make a composed object, which is kept as its word, or an interpolated one, which has a theta of its own.

    Ids are digests of the mode and the word: a repeat answers 200 with the same objects.
    """
    asked = await _read(request)
    members = await _members(runtime, asked)
    cost = cost_of(members[0][0].spec, *(functions for _, functions in members))
    with runtime.gates.points.admit(PROBE_POINTS * len(members) * cost):
        proposals = await while_there(request, runtime.run(propose, members, asked.mode))
    records, any_new = await _keep(request, runtime, proposals, cost)
    if any_new:
        response.status_code = 201
    shown = [StoredObject.of(record) for record in records]
    if asked.mode == "all":
        return ComposedObjects(objects=shown)
    if any_new:
        response.headers["Location"] = shown[0].links.self_
    return shown[0]


async def _read(request: Request) -> Composition:
    """The body. Raises InvalidInput where it is no JSON, RequestValidationError where it asks for something else."""
    body = await read_body(request, MAX_BODY_BYTES)
    try:
        return Composition.model_validate_json(body)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        if errors[0]["type"] == "json_invalid":
            raise InvalidInput("the body is no JSON") from error
        raise RequestValidationError(errors) from error


async def _members(runtime: Runtime, asked: Composition) -> list[tuple[Record, Functions]]:
    """The objects that are named, with their functions, each of which is read once, and none before all are known to
    go together. Raises NotFound for the first that is not there, and as `check_stored`."""
    ids = asked.objects
    records = await runtime.store.records([object_id for object_id in ids if is_id(object_id)])
    for index, object_id in enumerate(ids):
        if object_id not in records:
            raise NotFound(f"objects[{index}]: there is no object of this id", field=f"objects[{index}]")
    check_stored([records[object_id] for object_id in ids], asked.mode)
    found = {object_id: await runtime.store.get(object_id) for object_id in dict.fromkeys(ids)}
    return [found[object_id] for object_id in ids]


async def _keep(
    request: Request, runtime: Runtime, proposals: Sequence[Proposal], cost: int
) -> tuple[list[Record], bool]:
    """The objects as they are kept, and whether any is new. What cannot be sampled is refused before any is kept;
    a point of each takes as much as `cost` of the default model's."""
    kept = await runtime.store.records([proposal.record.id for proposal in proposals])
    fresh = [proposal for proposal in proposals if proposal.record.id not in kept]
    if not fresh:
        return [kept[proposal.record.id] for proposal in proposals], False
    n = PROBE_POINTS * len(fresh)
    check_cost(n, cost, runtime.settings.max_points, "objects")
    with runtime.gates.points.admit(n * cost):
        await while_there(request, runtime.run(check_values, fresh))
    return await runtime.store.put_all([(proposal.record, proposal.own) for proposal in proposals])
