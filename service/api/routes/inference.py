"""The encoders over the Open Inference Protocol, version 2, for the tools of KServe and Triton."""

import asyncio
from typing import Annotated, Final

from fastapi import APIRouter, Depends, Path, Query
from starlette.requests import Request
from starlette.responses import Response

from service import __version__
from service.api.admission import needs_gate
from service.api.context import client_of
from service.api.dependencies import ReadyRuntime
from service.api.inference_messages import (
    InferenceModel,
    InferenceServer,
    Live,
    ModelConfig,
    ModelReady,
    ServerReady,
    Tensor,
    TensorConfig,
    request_schema,
)
from service.api.inference_protocol import EXTENSION, HEADER_LENGTH, answer, max_body_bytes, parse, tensors
from service.api.queries import NoQuery
from service.api.responses.errors import BINARY, BODY_STALLED, OVERLOADED, Problem, Responses
from service.api.routes.health import check_ready
from service.api.wire.disconnects import while_connected
from service.api.wire.uploads import read_body
from service.encoding.encoder import Encoded, Encoder
from service.errors import InvalidParameter, NotFound, UnsupportedMedia
from service.mapping.spec import Array
from service.runtime.batcher import MAX_BATCH, Batcher

router = APIRouter(prefix="/v2", tags=["inference"])

NoParameters = Annotated[NoQuery, Query()]
MODEL_NOT_FOUND: Final[Responses] = {404: {"model": Problem, "description": "No loaded model of the name"}}
REQUEST_BODY: Final = {
    "required": True,
    "description": f"JSON; or JSON followed by the tensor's bytes, if `{HEADER_LENGTH}` gives the length of the JSON",
    "content": {"application/json": {"schema": request_schema()}, "application/octet-stream": BINARY},
}
RESPONSES: Final[Responses] = {
    200: {
        "description": "The outputs: as JSON or, if the request says so, as bytes after it, as in the body",
        "content": {"application/json": {"schema": {"type": "object"}}, "application/octet-stream": BINARY},
    },
    400: {
        "model": Problem,
        "description": f"A body that is not JSON, has too many lists, or is shorter than `{HEADER_LENGTH}`",
    },
    408: BODY_STALLED,
    413: {"model": Problem, "description": "More bytes than eight images take as JSON"},
    415: {"model": Problem, "description": "A compressed body"},
    422: {
        "model": Problem,
        "description": "A faulty member, too many elements, or images of the wrong shape or range for the model",
    },
    429: OVERLOADED,
}


async def encoder_named(
    request: Request, name: Annotated[str, Path(description="name of a loaded model")], runtime: ReadyRuntime
) -> Encoder:
    """Return the encoder that the path names. Raises NotFound for another model, or another version than `VERSION`."""
    version = request.path_params.get("version", VERSION)
    if version != VERSION:
        raise NotFound(f"the model has no such version; there is {VERSION}")
    try:
        return runtime.models.named(name, "image")
    except InvalidParameter as error:
        raise NotFound(error.detail) from error


VERSION: Final = "1"
VERSIONED: Final = {  # FastAPI lists only parameters of the function
    "parameters": [
        {
            "name": "version",
            "in": "path",
            "required": True,
            "description": "always 1: a changed model has another name",
            "schema": {"type": "string", "enum": [VERSION]},
        }
    ]
}
NamedEncoder = Annotated[Encoder, Depends(encoder_named)]


@router.get("")
async def server(query: NoParameters) -> InferenceServer:
    """Return the service's name, its version and the protocol extensions that it supports."""
    return InferenceServer(name="hof", version=__version__, extensions=[EXTENSION])


@router.get("/health/live")
async def live(query: NoParameters) -> Live:
    """Show that the process answers, like `/health/live`."""
    return Live(live=True)


@router.get("/health/ready")
async def ready(request: Request, query: NoParameters, runtime: ReadyRuntime) -> ServerReady:
    """Show that the service is ready, like `/health/ready`."""
    await check_ready(request, runtime.probes)
    return ServerReady(ready=True)


@router.get("/models/{name}", responses=MODEL_NOT_FOUND)
@router.get("/models/{name}/versions/{version}", responses=MODEL_NOT_FOUND, openapi_extra=VERSIONED)
async def model(query: NoParameters, encoder: NamedEncoder) -> InferenceModel:
    """Return the model's tensors. -1 stands for the batch: an inference takes at most eight images."""
    inputs, outputs = (
        [Tensor(name=name, datatype="FP32", shape=[-1, *shape]) for name, shape in each.items()]
        for each in tensors(encoder)
    )
    return InferenceModel(
        name=encoder.name, versions=[VERSION], platform="onnxruntime_onnx", inputs=inputs, outputs=outputs
    )


@router.get("/models/{name}/config", responses=MODEL_NOT_FOUND)
@router.get("/models/{name}/versions/{version}/config", responses=MODEL_NOT_FOUND, openapi_extra=VERSIONED)
async def model_config(query: NoParameters, encoder: NamedEncoder) -> ModelConfig:
    """Return the model's configuration, as Triton's `get_model_config` expects it."""
    inputs, outputs = (
        [TensorConfig(name=name, dims=shape) for name, shape in each.items()] for each in tensors(encoder)
    )
    return ModelConfig(name=encoder.name, max_batch_size=MAX_BATCH, input=inputs, output=outputs)


@router.get("/models/{name}/ready", responses=MODEL_NOT_FOUND)
@router.get("/models/{name}/versions/{version}/ready", responses=MODEL_NOT_FOUND, openapi_extra=VERSIONED)
async def model_ready(
    request: Request, query: NoParameters, encoder: NamedEncoder, runtime: ReadyRuntime
) -> ModelReady:
    """Show that the service is not about to stop, and that this model answers."""
    part = f"model {encoder.name}"
    await check_ready(request, {part: runtime.probes[part]})
    return ModelReady(name=encoder.name, ready=True)


@router.post(
    "/models/{name}/versions/{version}/infer",
    response_class=Response,
    responses=MODEL_NOT_FOUND | RESPONSES,
    openapi_extra={"requestBody": REQUEST_BODY, **VERSIONED},
)
@router.post(
    "/models/{name}/infer",
    response_class=Response,
    responses=MODEL_NOT_FOUND | RESPONSES,
    openapi_extra={"requestBody": REQUEST_BODY},
)
@needs_gate("images")
async def infer(request: Request, query: NoParameters, encoder: NamedEncoder, runtime: ReadyRuntime) -> Response:
    """Turn up to eight images into weights. The images must be framed already, and nothing is kept.

    The tensor `image` is (b, 3, size, size), float32. Channels are red, green, blue, in [0, 1]: sRGB levels divided by
    255. Rows run from the top. The object stands over white, centered; its longer side fills `foreground_ratio` of the
    square: `/model` has this share and the size. `/encode` does all of this itself; photos that a network masks it
    frames a little differently, and large objects in them it looks at twice.

    For any other photo, the output `theta` equals the weights of `/encode?store=false`, but for the rounding of
    `HOF_STORE_DTYPE=float16`. A
    model with color also has the output `color`. A model that makes estimates also has `shape_confidence` (b, 1) and
    `camera` (b, 4): azimuth, elevation, distance and roll, as in the answer of `/encode`.
    """
    if "content-encoding" in request.headers:
        raise UnsupportedMedia("the body must not be compressed", field="Content-Encoding")
    gates, max_bytes = runtime.gates, max_body_bytes(encoder)
    client = client_of(request.scope)
    with gates.images.admit(1, client) as admitted, gates.uploads.admit(0, client) as upload:
        body = await read_body(request, max_bytes, upload)
        work = runtime.run(parse, body, request.headers.get(HEADER_LENGTH), encoder)
        inference, images = await while_connected(request, work)
        admitted.grow_to(len(images))
        functions = await while_connected(request, _encode_each(runtime.batchers[encoder.name], images))
        content, headers = await while_connected(request, runtime.run(answer, encoder, inference, functions))
    return Response(content, headers=headers)


async def _encode_each(batcher: Batcher, images: Array) -> list[Encoded]:
    """Return the functions of each image; the batcher may encode it together with images of other requests."""
    return await asyncio.gather(*(batcher.encode(images[i : i + 1]) for i in range(len(images))))
