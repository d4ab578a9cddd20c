"""GET /objects/{id}/picture: a picture of an object, as a file."""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.context import client_of
from service.api.dependencies import ObjectId, ReadyRuntime
from service.api.queries import PictureQuery
from service.api.routes.file_answers import NOT_ACCEPTABLE, FileAnswer, file_responses, format_of
from service.formats.picture import PICTURE_FORMATS, PictureFormat
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.runtime.frames import complete_record
from service.runtime.options import PictureOptions
from service.runtime.pictures import picture_cost, picture_of

router = APIRouter(prefix="/objects", tags=["objects"])


@router.get(
    "/{id}/picture",
    response_class=Response,
    responses=file_responses("The picture in the chosen format", PICTURE_FORMATS.values()) | NOT_ACCEPTABLE,
)
async def picture(
    request: Request, id_: ObjectId, query: Annotated[PictureQuery, Query()], runtime: ReadyRuntime
) -> Response:
    """Draw the object: 40,000 of its points over white, in color if the object has colors."""
    fmt = format_of(request, query.format, PICTURE_FORMATS)
    record, frame = await complete_record(runtime, await runtime.store.record(id_), client=client_of(request.scope))
    answer = FileAnswer(id_, fmt, "picture", fmt.name, query.model_dump(exclude={"format"}), frame, vary="Accept")
    if response := answer.without_file(request):
        return response

    async def compute() -> bytes:
        _, functions = await runtime.store.get(id_)
        return await runtime.run(_picture_file, fmt, record.spec, functions, frame, query)

    return answer.with_file(compute, runtime.gates.points, picture_cost(record, query))


def _picture_file(
    fmt: PictureFormat, spec: MappingSpec, functions: Functions, frame: Frame, options: PictureOptions
) -> bytes:
    return fmt.dump(picture_of(spec, functions, frame, options))
