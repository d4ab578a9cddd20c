"""POST /encode: an image becomes an object."""

from collections.abc import Callable, Coroutine
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.admission import needs_gate
from service.api.context import client_of
from service.api.dependencies import ReadyRuntime
from service.api.queries import EncodeQuery
from service.api.responses.errors import BINARY, BODY_STALLED, NO_SPACE, OBJECT_LOCATION, OVERLOADED, Problem, Responses
from service.api.responses.objects import EncodedObject, EncodedWeights
from service.api.wire.disconnects import while_connected
from service.api.wire.uploads import Photo, read_photo
from service.encoding.encoder import Encoded, Encoder
from service.encoding.framing import Framed, preprocess
from service.encoding.report import ImageReport
from service.mapping.box import measure
from service.mapping.frame import Frame as ObjectFrame
from service.mapping.spec import Functions
from service.runtime.frames import complete_record
from service.runtime.parts import Runtime
from service.storage.ids import encoded_id
from service.storage.labels import MAX_LABEL
from service.storage.rows import Details, Record

router = APIRouter()

Frame = Callable[[], Coroutine[Any, Any, Framed]]

IMAGE_TYPES: Final = "PNG, JPEG, WebP or AVIF; HEIC if the service has the extra `heic`"
FORM: Final = {
    "schema": {
        "type": "object",
        "properties": {
            "image": {"type": "string", "format": "binary", "description": IMAGE_TYPES},
            "label": {
                "type": "string",
                "maxLength": MAX_LABEL,
                "description": "name of the object, one line; kept unless the object has one already",
            },
        },
        "required": ["image"],
    }
}
REQUEST_BODY: Final = {
    "required": True,
    "description": "The image: raw, or as the field `image` of a form, which may have a `label`, "
    "too. Its type is detected from its content.",
    "content": {
        "multipart/form-data": FORM,
        "image/png": BINARY,
        "image/jpeg": BINARY,
        "image/webp": BINARY,
        "image/avif": BINARY,
        "image/heic": BINARY,
    },
}
RESPONSES: Final[Responses] = {
    200: {
        "description": "The object that the same image gave before; or, with `store=false`, the weights",
    },
    201: {"model": EncodedObject, "description": "A new object", "headers": OBJECT_LOCATION},
    400: {"model": Problem, "description": "A truncated or corrupt image; a malformed form"},
    408: BODY_STALLED,
    413: {"model": Problem, "description": "More bytes, pixels, scans or memory for decoding than the limit"},
    415: {
        "model": Problem,
        "description": "The body is not an image of a supported type by its content, or it is empty",
    },
    422: {"model": Problem, "description": "A faulty parameter, or no object found in the image"},
    507: NO_SPACE,
    429: OVERLOADED,
}


@router.post(
    "/encode",
    tags=["objects"],
    response_model=EncodedObject | EncodedWeights,
    response_model_exclude_none=True,
    responses=RESPONSES,
    openapi_extra={"requestBody": REQUEST_BODY},
)
@needs_gate("images")
async def encode(
    request: Request, response: Response, query: Annotated[EncodeQuery, Query()], runtime: ReadyRuntime
) -> EncodedObject | EncodedWeights:
    """Turn the photo of one object into a mapping function, and keep it.

    The id is a digest of the image's bytes, its framing, and the models. A repeat answers 200 with the same object
    and costs no inference; the masks of recent photos are cached. Of its label and its photo, a repeat adds what the
    object lacks, and changes nothing.
    """
    encoder, settings, gates = runtime.models.named(query.model), runtime.settings, runtime.gates
    framing = encoder.framing
    if query.foreground_ratio is not None:
        framing = replace(framing, foreground_ratio=query.foreground_ratio)
    max_bytes, max_pixels = settings.max_image_bytes, settings.max_image_pixels
    client = client_of(request.scope)
    with gates.images.admit(client=client), gates.uploads.admit(0, client) as upload:
        photo = await read_photo(request, max_bytes, upload)
        args = (photo.image, framing, query.background, max_pixels, runtime.matting)
        keep = query.keep_photo and query.store
        frame = partial(runtime.run_stoppable, lambda stop: preprocess(*args, stop, thumbnail=keep))
        if not query.store:
            framed, encoded, box = await while_connected(request, _encode(frame, runtime, encoder))
            return EncodedWeights.of(encoder.name, encoder.spec, encoded, box, framed)
        work = _look_up_or_encode(frame, runtime, encoder, photo, framing.foreground_ratio, client)
        framed, record, functions, is_stored = await while_connected(request, work)
        record, is_new = (record, False) if is_stored else await runtime.store.put(record, functions, framed.thumbnail)
    kept = functions if query.include == "weights" else None
    answer = EncodedObject.of_image(record, framed, kept, settings.root_path)
    if is_new:
        response.status_code = 201
        response.headers["Location"] = answer.links.self_
    return answer


async def _encode(frame: Frame, runtime: Runtime, encoder: Encoder) -> tuple[Framed, Encoded, ObjectFrame]:
    framed = await frame()
    return framed, *await _functions(runtime, encoder, framed)


async def _functions(runtime: Runtime, encoder: Encoder, framed: Framed) -> tuple[Encoded, ObjectFrame]:
    """Return the functions of a framed image, and the box that they fill."""
    functions = await runtime.batchers[encoder.name].encode(framed.tensor)
    return functions, await runtime.run(measure, encoder.spec, functions.theta)


async def _look_up_or_encode(
    frame: Frame, runtime: Runtime, encoder: Encoder, photo: Photo, foreground_ratio: float, client: str | None
) -> tuple[Framed, Record, Functions, bool]:
    """Return the framed image, its object, its functions, and whether the object is stored already."""
    framed = await frame()
    models = [encoder.digest]
    if framed.mask == "matting" and runtime.matting:
        models.append(runtime.matting.digest)
    object_id = encoded_id(photo.image, framed.mask, foreground_ratio, *models)
    match = await runtime.store.find(object_id)
    report = ImageReport.of(framed)
    if match is not None:
        record, functions = match
        details = Details(report, photo.label, framed.thumbnail)
        record, _ = await complete_record(runtime, record, details, client=client)
        return framed, record, functions, True
    encoded, box = await _functions(runtime, encoder, framed)
    record = Record(
        object_id,
        "encoded",
        encoder.name,
        encoder.spec,
        datetime.now(UTC),
        color_spec=encoder.color_spec,
        frame=box,
        image=report,
        estimates=encoded.estimates.rounded() if encoded.estimates else None,
        label=photo.label,
        has_photo=framed.thumbnail is not None,
    )
    return framed, record, encoded, False
