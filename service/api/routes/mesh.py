"""GET /objects/{id}/mesh: an object's surface, as a file."""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.queries import MeshQuery
from service.api.routes.file_answers import NOT_ACCEPTABLE, ObjectId, attachment, cached, file_responses, head
from service.api.wire.caching import etag, is_fresh
from service.api.wire.disconnects import while_there
from service.api.wire.negotiation import negotiate
from service.formats.mesh.registry import MESH_FORMATS, MeshFormat
from service.mapping.spec import Functions, MappingSpec
from service.runtime.cost import check_cost, cost_of
from service.runtime.parts import Ready
from service.runtime.shapes import functions_for, mesh_of

router = APIRouter(prefix="/objects", tags=["objects"])


@router.get(
    "/{id}/mesh",
    response_class=Response,
    responses=file_responses("The surface in the chosen format", MESH_FORMATS.values()) | NOT_ACCEPTABLE,
)
async def mesh(request: Request, id_: ObjectId, query: Annotated[MeshQuery, Query()], runtime: Ready) -> Response:
    """The object's surface: triangles of the canonical domain through f^k, with normals, in the object frame (+Y up,
    front +Z, longest side 1), whatever the format; each vertex with its colour where the object has colours and the
    format holds them.

    What f tears apart is left open, and a solid domain gives layers: for looking at, not a closed solid.
    """
    accept = request.headers.get("accept")
    fmt = MESH_FORMATS[query.format] if query.format else negotiate(accept, MESH_FORMATS.values())
    record, functions = await runtime.store.get(id_)
    functions = functions_for(functions, query.color, holds_color=fmt.holds_color)
    n, cost = 20 * query.resolution**2, cost_of(record.spec, functions)
    check_cost(n, cost, runtime.settings.max_points, "resolution")
    headers = cached(etag(id_, "mesh", fmt.name, query.model_dump(exclude={"format"}))) | {"Vary": "Accept"}
    if is_fresh(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    headers |= attachment(id_, fmt.extension)
    if "hof.head" in request.scope:
        return head(headers, fmt.media_type)
    with runtime.gates.points.admit(n * cost):
        data = await while_there(request, runtime.run(_file, fmt, record.spec, functions, query))
    return Response(data, headers=headers, media_type=fmt.media_type)


def _file(fmt: MeshFormat, spec: MappingSpec, functions: Functions, query: MeshQuery) -> bytes:
    return fmt.dump(mesh_of(spec, functions, query))
