"""GET /objects/{id}/points: an object's point cloud, streamed as a file."""

from collections.abc import AsyncIterator

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from service.api.context import client_of
from service.api.dependencies import ObjectId, ReadyRuntime
from service.api.queries import PointsQuery, parameters_of, read_query
from service.api.routes.file_answers import NOT_ACCEPTABLE, FileAnswer, file_responses, format_of
from service.api.wire.caching import accepts_gzip
from service.api.wire.disconnects import AdmittedStream
from service.formats.points.registry import POINT_FORMATS, PointFormat
from service.mapping.canonical import check_range
from service.mapping.frame import Frame
from service.runtime.cost import check_cost, check_size, cost_of_object, in_flight
from service.runtime.frames import complete_record
from service.runtime.poses import POSE_POINTS, View, pose_of, view_of
from service.runtime.shapes import cloud_of
from service.runtime.streaming import gzipped, stream

router = APIRouter(prefix="/objects", tags=["objects"])


@router.get(
    "/{id}/points",
    response_class=StreamingResponse,
    responses=file_responses("The points, streamed", POINT_FORMATS.values()) | NOT_ACCEPTABLE,
    openapi_extra={"parameters": parameters_of(PointsQuery)},
)
async def points(request: Request, id_: ObjectId, runtime: ReadyRuntime) -> Response:
    """Sample the object: canonical points through f^k, in the object frame (+Y up, front +Z, longest side `scale`).

    The frame is that of the whole object, so all clouds of an object share it; a cloud of few points does not quite
    reach its sides. With `frame=camera`, points are where the photo's camera sees them.

    Points have colors if the object has colors and the format holds them.

    The first m points of n are the points of m; `offset` continues where another call stopped.
    """
    query = read_query(request, PointsQuery)
    fmt, settings = format_of(request, query.format, POINT_FORMATS), runtime.settings
    check_size(fmt, query.n, settings.max_points)
    check_range(query.n, query.seed, query.offset, query.sampling)
    record, frame = await complete_record(runtime, await runtime.store.record(id_), client=client_of(request.scope))
    view = view_of(query, record.estimates, record.image)
    in_color = query.color == "auto" and record.color_spec is not None
    cost = cost_of_object(record, in_color=in_color)
    check_cost(query.n, cost, settings.max_points, "n")
    fmt = fmt.holding(color=in_color, camera=view is not None)
    is_gzipped = fmt.is_text and accepts_gzip(request.headers.get("accept-encoding"))
    answer = _file_answer(id_, fmt, query, frame, view, is_gzipped=is_gzipped)
    if response := answer.without_file(request):
        return response

    async def begin() -> AsyncIterator[bytes]:
        _, functions = await runtime.store.get(id_)
        pose = await runtime.run(pose_of, view, record.spec, functions, frame) if view else None
        pieces = stream(fmt, cloud_of(record.spec, functions, frame, query, pose), runtime.run, settings.threads)
        return gzipped(pieces, runtime.run) if is_gzipped else pieces

    amount = cost * (in_flight(query.n, settings.threads) + (POSE_POINTS if view else 0))
    return AdmittedStream(begin, runtime.gates.points, amount, answer.headers, answer.media_type)


def _file_answer(
    id_: str, fmt: PointFormat, query: PointsQuery, frame: Frame, view: View | None, *, is_gzipped: bool
) -> FileAnswer:
    options = query.model_dump(exclude={"format"}, exclude_none=True)
    tagged = (fmt.name, options, frame, *([view] if view else []), is_gzipped)
    length = fmt.length(query.n)
    return FileAnswer(id_, fmt, *tagged, vary="Accept, Accept-Encoding", length=length, is_gzipped=is_gzipped)
