"""GET /objects/{id}/mesh: an object's surface, as a file."""

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from service.api.context import client_of
from service.api.dependencies import ObjectId, ReadyRuntime
from service.api.queries import MeshQuery, parameters_of, read_query
from service.api.routes.file_answers import NOT_ACCEPTABLE, FileAnswer, file_responses, format_of
from service.formats.mesh.registry import MESH_FORMATS, MeshFormat
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.runtime.cost import check_cost, cost_of_object
from service.runtime.frames import complete_record
from service.runtime.options import MeshOptions
from service.runtime.poses import POSE_POINTS, View, pose_of, view_of
from service.runtime.shapes import functions_for, mesh_of

router = APIRouter(prefix="/objects", tags=["objects"])


@router.get(
    "/{id}/mesh",
    response_class=Response,
    responses=file_responses("The surface in the chosen format", MESH_FORMATS.values()) | NOT_ACCEPTABLE,
    openapi_extra={"parameters": parameters_of(MeshQuery)},
)
async def mesh(request: Request, id_: ObjectId, runtime: ReadyRuntime) -> Response:
    """Compute the object's surface: triangles of the canonical domain through f^k, with normals.

    Every format uses the object frame (+Y up, front +Z, longest side `scale`), or with `frame=camera` that of the
    photo's camera. Vertices have colors if the object has
    colors and the format holds them.

    The surface is for display, not a closed solid: it is open where f tears parts apart, and a solid domain gives
    several layers.
    """
    query = read_query(request, MeshQuery)
    fmt = format_of(request, query.format, MESH_FORMATS)
    record, frame = await complete_record(runtime, await runtime.store.record(id_), client=client_of(request.scope))
    view = view_of(query, record.estimates, record.image)
    in_color = query.color == "auto" and fmt.holds_color
    n, cost = 20 * query.resolution**2, cost_of_object(record, in_color=in_color)
    check_cost(n, cost, runtime.settings.max_points, "resolution")
    options = query.model_dump(exclude={"format"}, exclude_none=True)
    tagged = (fmt.name, options, frame, *([view] if view else []))
    answer = FileAnswer(id_, fmt, "mesh", *tagged, vary="Accept")
    if response := answer.without_file(request):
        return response

    async def compute() -> bytes:
        _, functions = await runtime.store.get(id_)
        functions = functions_for(functions, query.color, holds_color=fmt.holds_color)
        return await runtime.run(_mesh_file, fmt, record.spec, functions, frame, query, view)

    return answer.with_file(compute, runtime.gates.points, (n + (POSE_POINTS if view else 0)) * cost)


def _mesh_file(
    fmt: MeshFormat, spec: MappingSpec, functions: Functions, frame: Frame, options: MeshOptions, view: View | None
) -> bytes:
    return fmt.dump(mesh_of(spec, functions, frame, options, pose_of(view, spec, functions, frame)))
