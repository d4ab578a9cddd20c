"""POST /encode: an image, several of one object, or points of a part of it, become an object."""

from collections.abc import Sequence
from typing import Final

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from service.api.admission import needs_gate
from service.api.context import client_of
from service.api.dependencies import ready_runtime
from service.api.queries import EncodeQuery, parameters_of, read_query
from service.api.responses.completed import CompletedObject, CompletedWeights
from service.api.responses.errors import BINARY, BODY_STALLED, NO_SPACE, OBJECT_LOCATION, OVERLOADED, Problem, Responses
from service.api.responses.objects import EncodedObject, EncodedWeights, StoredObject
from service.api.wire.disconnects import while_connected
from service.api.wire.uploads import read_upload
from service.encoding.completion import IMAGES as COMPLETING
from service.encoding.encoder import Encoded, Encoder
from service.encoding.framing import Framed
from service.encoding.report import ImageReport
from service.errors import InvalidParameter
from service.formats.scans.read import NAMES
from service.labels import LABEL_SCHEMA
from service.mapping.frame import Frame as ObjectFrame
from service.mapping.spec import Functions
from service.runtime.frames import complete_record
from service.runtime.inputs.photos import PhotoKey, RecentPhoto, photo_key, photo_record
from service.runtime.inputs.scans import Placement, complete, point_inputs, points_record
from service.runtime.inputs.views import MAX_IMAGES, Photos, encode_all, frame_all, id_of
from service.runtime.parts import Runtime
from service.storage.ids import points_id
from service.storage.rows import Details, Record

router = APIRouter()

IMAGE_TYPES: Final = "PNG, JPEG, WebP or AVIF; HEIC if the service has the extra `heic`"
FORM: Final = {
    "schema": {
        "type": "object",
        "properties": {
            "image": {
                "type": "array",
                "items": {"type": "string", "format": "binary"},
                "minItems": 1,
                "maxItems": MAX_IMAGES,
                "description": f"{IMAGE_TYPES}. Repeat the field for several, different images of one object",
            },
            "points": {
                "type": "string",
                "format": "binary",
                "description": f"in place of images: {NAMES}, of the object or of a part of it, +Y up, the front at +Z",
            },
            "label": {
                "type": "string",
                **LABEL_SCHEMA,
                "description": "name of the object, one line; kept unless the object has one already",
            },
        },
        "oneOf": [{"required": ["image"]}, {"required": ["points"]}],
    }
}
REQUEST_BODY: Final = {
    "required": True,
    "description": "The image: raw, or as the field `image` of a form, which may have a `label`, "
    f"too. A form may have up to {MAX_IMAGES} images of one object, together no larger than one may be. Types are "
    f"detected from the content. In place of an image: {NAMES}.",
    "content": {
        "multipart/form-data": FORM,
        "image/png": BINARY,
        "image/jpeg": BINARY,
        "image/webp": BINARY,
        "image/avif": BINARY,
        "image/heic": BINARY,
        "model/gltf-binary": BINARY,
        "model/obj": BINARY,
        "model/stl": BINARY,
        "application/octet-stream": BINARY,
    },
}
RESPONSES: Final[Responses] = {
    200: {
        "description": "The object that the same images gave before; or, with `store=false`, the weights",
    },
    201: {"model": EncodedObject | CompletedObject, "description": "A new object", "headers": OBJECT_LOCATION},
    400: {"model": Problem, "description": "A truncated or corrupt image or file of points; a malformed form"},
    408: BODY_STALLED,
    413: {"model": Problem, "description": "More bytes, pixels, scans or memory for decoding than the limit"},
    415: {
        "model": Problem,
        "description": "The body is neither an image nor points of a supported type by its content, or it is empty; or "
        "no model for it is loaded",
    },
    422: {"model": Problem, "description": "A faulty parameter, or no object found in the image"},
    507: NO_SPACE,
    429: OVERLOADED,
}


@router.post(
    "/encode",
    tags=["objects"],
    response_model=EncodedObject | CompletedObject | EncodedWeights | CompletedWeights,
    response_model_exclude_none=True,
    responses=RESPONSES,
    openapi_extra={"parameters": parameters_of(EncodeQuery), "requestBody": REQUEST_BODY},
)
@needs_gate("images")
async def encode(request: Request) -> Response:
    """Turn the photo of one object, or points of a part of it, into a mapping function, and keep it.

    The id is a digest of the image's bytes, its framing, and the models. A repeat answers 200 with the same object
    and costs no inference; a recent photo is not even decoded. Of its label and its photo, a repeat adds what the
    object lacks, and changes nothing.

    Several images, views of one object from different sides, make one object: its theta is the mean of theirs.

    Points are completed by a model that takes them: the side of the front is found, and the object is fitted to them.
    The answer's `placement` puts the whole object where they lie. A repeat of points is encoded again.
    """
    runtime = await ready_runtime(request)
    query = read_query(request, EncodeQuery)
    runtime.models.named(query.model)  # a wrong name is refused before the body is read
    client, gates = client_of(request.scope), runtime.gates
    with gates.images.admit(client=client) as admitted, gates.uploads.admit(0, client) as upload:
        images, label, points = await read_upload(request, runtime.settings.max_image_bytes, upload)
        amount = len(images) if points is None else COMPLETING
        if amount > 1:  # one is admitted already
            admitted.grow_to(amount)
        answer: EncodedObject | CompletedObject | EncodedWeights | CompletedWeights
        if points is not None:
            answer, is_new = await _answer_points(request, query, runtime, points, label)
        else:
            answer, is_new = await _answer_photos(request, query, runtime, images, label)
    headers = {"Location": answer.links.self_} if is_new and isinstance(answer, StoredObject) else None
    content = answer.model_dump_json(by_alias=True, exclude_none=True)
    return Response(content, 201 if headers else 200, headers, "application/json")


async def _answer_photos(
    request: Request, query: EncodeQuery, runtime: Runtime, images: Sequence[bytes], label: str | None
) -> tuple[EncodedObject | EncodedWeights, bool]:
    """Return the answer to images, and whether its object is new."""
    encoder, client, is_new = runtime.models.named(query.model, "image"), client_of(request.scope), False
    framing = encoder.framing.with_ratio(query.foreground_ratio)
    photos = Photos(images, framing, query.background, query.keep_photo and query.store)
    if not query.store:
        views, encoded, box = await while_connected(request, _encode(runtime, encoder, photos))
        return EncodedWeights.of(encoder.name, encoder.spec, encoded, box, _reports(views)), False
    key = photo_key(images, encoder, query.background, framing.foreground_ratio)
    repeat = await _find_repeat(runtime, key, label, query, client)
    if repeat:
        record, reports, functions = repeat
    else:
        work = _look_up_or_encode(runtime, encoder, photos, label, client)
        views, record, functions, is_stored = await while_connected(request, work)
        reports = _reports(views)
        if not is_stored:
            record, is_new = await runtime.store.put(record, functions, views[0].thumbnail)
        runtime.recent_photos.keep(key, RecentPhoto(record.id, reports))
    kept = functions if query.include == "weights" else None
    return EncodedObject.of_image(record, reports, kept, runtime.settings.root_path), is_new


async def _answer_points(
    request: Request, query: EncodeQuery, runtime: Runtime, points: bytes, label: str | None
) -> tuple[CompletedObject | CompletedWeights, bool]:
    """Return the answer to a file of points or a mesh, and whether its object is new."""
    for name in ("background", "foreground_ratio", "keep_photo"):
        if getattr(query, name) != EncodeQuery.model_fields[name].default:
            raise InvalidParameter(f"{name} is for images: leave it out with points or a mesh", field=name)
    encoder, client = runtime.models.named(query.model, "points"), client_of(request.scope)
    inputs = await while_connected(request, runtime.run(point_inputs, points, encoder))
    sent, functions, box = await while_connected(request, complete(runtime, encoder, inputs))
    if not query.store:
        return CompletedWeights.of(encoder.name, encoder.spec, functions, box, Placement.of(sent, box)), False
    object_id = points_id(points, encoder.digest)
    if match := await runtime.store.find(object_id):
        (record, stored), is_new = match, False
        record, box = await complete_record(runtime, record, Details(label=label), client=client)
    else:
        stored = functions
        record, is_new = await runtime.store.put(points_record(object_id, encoder, box, label), functions)
    kept = stored if query.include == "weights" else None
    return CompletedObject.of_points(record, Placement.of(sent, box), kept, runtime.settings.root_path), is_new


async def _find_repeat(
    runtime: Runtime, key: PhotoKey, label: str | None, query: EncodeQuery, client: str | None
) -> tuple[Record, tuple[ImageReport, ...], Functions | None] | None:
    """Return the stored object of recent photos without decoding them; None if they have to be decoded.

    The functions are read only if the answer holds them.
    """
    recent = runtime.recent_photos.find(key)
    if recent is None:
        return None
    if query.include == "weights":
        record, functions = await runtime.store.find(recent.object_id) or (None, None)
    else:
        record, functions = await runtime.store.find_record(recent.object_id), None
    if record is None or (query.keep_photo and not record.has_photo):
        return None
    record, _ = await complete_record(runtime, record, Details(label=label), client=client)
    return record, recent.reports, functions


async def _encode(runtime: Runtime, encoder: Encoder, photos: Photos) -> tuple[list[Framed], Encoded, ObjectFrame]:
    with runtime.batchers[encoder.name].coming():
        views = await frame_all(runtime, photos)
    return views, *await encode_all(runtime, encoder, views)


async def _look_up_or_encode(
    runtime: Runtime, encoder: Encoder, photos: Photos, label: str | None, client: str | None
) -> tuple[list[Framed], Record, Functions, bool]:
    """Return the framed images, their object, its functions, and whether the object is stored already.

    The report and the picture that are kept with the object are those of the first image.
    """
    with runtime.batchers[encoder.name].coming():
        views = await frame_all(runtime, photos)
        object_id = id_of(runtime, encoder, photos, views)
        is_stored = await runtime.store.find_record(object_id) is not None
        match = await runtime.store.find(object_id) if is_stored else None
    if match is not None:
        record, functions = match
        details = Details(ImageReport.of(views[0]), label, views[0].thumbnail)
        record, _ = await complete_record(runtime, record, details, client=client)
        return views, record, functions, True
    encoded, box = await encode_all(runtime, encoder, views)
    record = photo_record(object_id, views[0], encoder, encoded, box, label)
    return views, record, encoded, False


def _reports(views: Sequence[Framed]) -> tuple[ImageReport, ...]:
    return tuple(map(ImageReport.of, views))
