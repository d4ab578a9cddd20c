"""POST /encode: an image becomes an object."""

from collections.abc import Callable, Coroutine
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.queries import EncodeQuery
from service.api.responses import OVERLOADED, EncodedObject, EncodedWeights, Problem
from service.api.routes.file_answers import BINARY
from service.api.wire.disconnects import while_there
from service.api.wire.uploads import read_image, size_ahead
from service.encoding.encoder import Encoder
from service.encoding.framing import Framed, preprocess
from service.mapping.spec import Functions
from service.runtime.batcher import Batcher
from service.runtime.parts import Ready, Runtime
from service.storage.ids import encoded_id
from service.storage.store import Record

router = APIRouter()

Frame = Callable[[], Coroutine[Any, Any, Framed]]

FORM: Final = {
    "schema": {
        "type": "object",
        "properties": {"image": {"type": "string", "format": "binary", "description": "PNG, JPEG or WebP"}},
        "required": ["image"],
    }
}
REQUEST_BODY: Final = {
    "required": True,
    "description": "The image: raw, or as the field `image` of a form. Its type is told by its content.",
    "content": {
        "multipart/form-data": FORM,
        "image/png": BINARY,
        "image/jpeg": BINARY,
        "image/webp": BINARY,
    },
}
RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "The object that the same image gave before; or, with `store=false`, the weights",
    },
    201: {
        "model": EncodedObject,
        "description": "A new object",
        "headers": {"Location": {"description": "path of the object", "schema": {"type": "string"}}},
    },
    400: {"model": Problem, "description": "A truncated or corrupt image; a malformed form"},
    408: {"model": Problem, "description": "The rest of the body does not come"},
    413: {"model": Problem, "description": "More bytes or pixels than the limit"},
    415: {"model": Problem, "description": "The body is no PNG, JPEG or WebP by its content; it is empty, say"},
    422: {"model": Problem, "description": "A faulty parameter, or no object found in the image"},
    507: {"model": Problem, "description": "The store has no space left; the object is not kept"},
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
async def encode(
    request: Request, response: Response, query: Annotated[EncodeQuery, Query()], runtime: Ready
) -> EncodedObject | EncodedWeights:
    """Turn the photo of one object into a mapping function, and keep it.

    The id is a digest of the image's bytes, how it was framed, and the models: a repeat answers 200 with
    the same object and costs no inference; mattes are remembered for the last photos.
    """
    encoder, settings, gates = runtime.models.named(query.model), runtime.settings, runtime.gates
    framing = encoder.framing
    if query.foreground_ratio is not None:
        framing = replace(framing, foreground_ratio=query.foreground_ratio)
    max_bytes, max_pixels = settings.max_image_bytes, settings.max_image_pixels
    with gates.images.admit(), gates.uploads.admit(size_ahead(request, max_bytes)):
        image = await read_image(request, max_bytes)
        frame = partial(runtime.run, preprocess, image, framing, query.background, max_pixels, runtime.matting)
        if not query.store:
            framed, functions = await while_there(request, _encoded(frame, runtime.batchers[encoder.name]))
            return EncodedWeights.of(encoder.name, encoder.spec, functions, framed)
        asked = _found_or_encoded(frame, runtime, encoder, image, framing.foreground_ratio)
        framed, record, functions, known = await while_there(request, asked)
        record, created = (record, False) if known else await runtime.store.put(record, functions)
    if created:
        response.status_code = 201
        response.headers["Location"] = f"/objects/{record.id}"
    return EncodedObject.of_image(record, framed, functions if query.include == "weights" else None)


async def _encoded(frame: Frame, batcher: Batcher) -> tuple[Framed, Functions]:
    framed = await frame()
    return framed, await batcher.encode(framed.tensor)


async def _found_or_encoded(
    frame: Frame, runtime: Runtime, encoder: Encoder, image: bytes, foreground_ratio: float
) -> tuple[Framed, Record, Functions, bool]:
    """The framed image, its object, its functions, and whether it is known: else it is to be kept."""
    framed = await frame()
    models = [encoder.digest]
    if framed.mask == "matting" and runtime.matting:
        models.append(runtime.matting.digest)
    object_id = encoded_id(image, framed.mask, foreground_ratio, *models)
    known = await runtime.store.find(object_id)
    if known is not None:
        return framed, *known, True
    functions = await runtime.batchers[encoder.name].encode(framed.tensor)
    new = Record(object_id, "encoded", encoder.name, encoder.spec, datetime.now(UTC), color_spec=encoder.color_spec)
    return framed, new, functions, False
