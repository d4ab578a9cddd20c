"""POST /encode: an image becomes an object."""

from collections.abc import Callable, Coroutine
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
from service.runtime.photos import PhotoKey, photo_id, photo_key, photo_record
from service.storage.labels import LABEL_SCHEMA
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
                **LABEL_SCHEMA,
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
    and costs no inference; a recent photo is not even decoded. Of its label and its photo, a repeat adds what the
    object lacks, and changes nothing.
    """
    encoder, settings, gates = runtime.models.named(query.model), runtime.settings, runtime.gates
    framing = encoder.framing.with_ratio(query.foreground_ratio)
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
        key = photo_key(photo.image, encoder, query.background, framing.foreground_ratio)
        repeat, is_new = await _find_repeat(runtime, key, photo.label, query, client), False
        if repeat:
            record, report, functions = repeat
        else:
            work = _look_up_or_encode(frame, runtime, encoder, photo, framing.foreground_ratio, client)
            framed, record, functions, is_stored = await while_connected(request, work)
            report = ImageReport.of(framed)
            if not is_stored:
                record, is_new = await runtime.store.put(record, functions, framed.thumbnail)
            runtime.recent_photos.keep(key, record.id)
    kept = functions if query.include == "weights" else None
    answer = EncodedObject.of_image(record, report, kept, settings.root_path)
    if is_new:
        response.status_code = 201
        response.headers["Location"] = answer.links.self_
    return answer


async def _find_repeat(
    runtime: Runtime, key: PhotoKey, label: str | None, query: EncodeQuery, client: str | None
) -> tuple[Record, ImageReport, Functions | None] | None:
    """Return the stored object of a recent photo without decoding the photo; None if it has to be decoded.

    The functions are read only if the answer holds them.
    """
    object_id = runtime.recent_photos.find(key)
    if object_id is None:
        return None
    if query.include == "weights":
        record, functions = await runtime.store.find(object_id) or (None, None)
    else:
        record, functions = await runtime.store.find_record(object_id), None
    if record is None or record.image is None or (query.keep_photo and not record.has_photo):
        return None
    record, _ = await complete_record(runtime, record, Details(label=label), client=client)
    return (record, record.image, functions) if record.image else None


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
    object_id = photo_id(photo.image, framed, foreground_ratio, encoder, runtime.matting)
    match = await runtime.store.find(object_id)
    if match is not None:
        record, functions = match
        details = Details(ImageReport.of(framed), photo.label, framed.thumbnail)
        record, _ = await complete_record(runtime, record, details, client=client)
        return framed, record, functions, True
    encoded, box = await _functions(runtime, encoder, framed)
    record = photo_record(object_id, framed, encoder, encoded, box, photo.label)
    return framed, record, encoded, False
