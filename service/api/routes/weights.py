"""GET /objects/{id}/weights: an object's weights, as a file."""

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from service.api.context import client_of
from service.api.dependencies import ObjectId, ReadyRuntime
from service.api.queries import WeightsQuery, parameters_of, read_query
from service.api.routes.file_answers import FileAnswer, file_responses
from service.formats.weights import WEIGHT_FORMATS, Weights, check_dtype, dump
from service.mapping.box import PROBE_POINTS
from service.runtime.cost import cost_of_object
from service.runtime.frames import complete_record

router = APIRouter(prefix="/objects", tags=["objects"])


@router.get(
    "/{id}/weights",
    response_class=Response,
    responses=file_responses("theta in the chosen format", WEIGHT_FORMATS.values()),
    openapi_extra={"parameters": parameters_of(WeightsQuery)},
)
async def weights(request: Request, id_: ObjectId, runtime: ReadyRuntime) -> Response:
    """Return theta with its spec: everything needed to sample the object elsewhere.

    The file of a composed object holds its k thetas and its word. Of an object in color, safetensors and JSON also
    hold the color's weights and their spec. An ONNX file is one function, x -> points in the object frame,
    which runs anywhere; theta itself gives the function's own numbers, and the files carry the box (`frame`).

    `dtype=float16` or `int8` makes a safetensors file two or four times shorter; `loss` in its metadata tells how far
    the object's points move because of that.
    """
    query = read_query(request, WeightsQuery)
    check_dtype(query.format, query.dtype)
    record, frame = await complete_record(runtime, await runtime.store.record(id_), client=client_of(request.scope))
    answer = FileAnswer(id_, WEIGHT_FORMATS[query.format], query.format, query.dtype, frame)
    if response := answer.without_file(request):
        return response

    async def compute() -> bytes:
        _, functions = await runtime.store.get(id_)
        word = record.members if record.kind == "composed" else ()
        content = Weights(record.spec, functions.theta, record.model, word, functions.color, frame, query.dtype)
        return await runtime.run(dump, content, query.format)

    return answer.with_file(compute, runtime.gates.points, PROBE_POINTS * cost_of_object(record))
