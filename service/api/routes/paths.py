"""POST /objects/{id}/path: a collision-free path around an object."""

from typing import Annotated, Final

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field
from starlette.requests import Request
from starlette.responses import Response

from service.api.admission import needs_gate
from service.api.context import client_of
from service.api.dependencies import ObjectId, ReadyRuntime
from service.api.queries import PathBody, PathQuery
from service.api.responses.errors import BINARY, BODY_STALLED, OBJECT_NOT_FOUND, OVERLOADED, Problem, Responses
from service.api.routes.file_answers import NOT_ACCEPTABLE, format_of
from service.api.wire.disconnects import while_connected
from service.api.wire.json_bodies import read_json
from service.formats.path import PATH_FORMATS, PathFormat
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.planning.path import Reason
from service.runtime.frames import complete_record
from service.runtime.options import PathOptions
from service.runtime.paths import path_cost, path_of

router = APIRouter(prefix="/objects", tags=["objects"])

MAX_BODY_BYTES: Final = 4096

Waypoint = Annotated[list[float], Field(min_length=3, max_length=3)]


class PlannedPath(BaseModel):
    """A path around an object, or why there is none."""

    path: list[Waypoint] | None = Field(
        description="waypoints x, y, z from start to goal, to be joined by straight lines, in the frame and scale of "
        "the request; null if there is no path",
        examples=[[[-0.9, 0.1, 0.2], [0.03, 0.66, 0.22], [0.9, 0.1, -0.2]]],
    )
    length: float | None = Field(description="of the path, in the unit of `scale`", examples=[2.21])
    straight: bool = Field(description="the path is the straight line from start to goal")
    reason: Reason | None = Field(
        description="why there is no path: `start inside` or `goal inside` the object or nearer to it than "
        "`clearance`; `enclosed`: no free cells lead from one to the other. Null if there is a path"
    )


REQUEST_BODY: Final = {"required": True, "content": {"application/json": {"schema": PathBody.model_json_schema()}}}
RESPONSES: Final[Responses] = {
    **OBJECT_NOT_FOUND,
    **NOT_ACCEPTABLE,
    200: {
        "model": PlannedPath,
        "description": "The path; in JSON also that there is none",
        "content": {PATH_FORMATS["glb"].media_type: BINARY},
    },
    400: {"model": Problem, "description": "The body is not JSON"},
    408: BODY_STALLED,
    413: {"model": Problem, "description": "More bytes than such a call can need"},
    422: {
        "model": Problem,
        "description": "A parameter is unknown, of the wrong type or out of range; with `format=glb`: there is no path",
    },
    429: OVERLOADED,
}


@router.post("/{id}/path", response_class=Response, responses=RESPONSES, openapi_extra={"requestBody": REQUEST_BODY})
@needs_gate("points")
async def path(
    request: Request, id_: ObjectId, query: Annotated[PathQuery, Query()], runtime: ReadyRuntime
) -> Response:
    """Plan a short path from start to goal around the object. Nothing is kept.

    The path is planned in the cube around the object, cut into cells. It stays in cells that are free of the object's
    points (64 cells^2 of them, `sampling=sobol`) and of all cells nearer to those than `clearance`. So it keeps this
    distance from these points.

    The object is its surface: a goal in the hollow of a closed object cannot be reached from outside.
    """
    fmt = format_of(request, query.format, PATH_FORMATS)
    options = await read_json(request, PathBody, MAX_BODY_BYTES)
    client = client_of(request.scope)
    record, frame = await complete_record(runtime, await runtime.store.record(id_), client=client)
    with runtime.gates.points.admit(path_cost(record.spec, options, runtime.settings.max_points), client):
        _, functions = await runtime.store.get(id_)
        work = runtime.run(_path_file, fmt, record.spec, functions, frame, options)
        content = await while_connected(request, work)
    return Response(content, headers={"Vary": "Accept"}, media_type=fmt.media_type)


def _path_file(fmt: PathFormat, spec: MappingSpec, functions: Functions, frame: Frame, options: PathOptions) -> bytes:
    return fmt.dump(path_of(spec, functions, frame, options))
