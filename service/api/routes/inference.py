"""The encoders by the Open Inference Protocol, version 2, as KServe's and Triton's tools speak it."""

import asyncio
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Path, Query
from starlette.requests import Request
from starlette.responses import Response

from service import __version__
from service.api.inference_protocol import (
    EXTENSION,
    HEADER_LENGTH,
    InferenceModel,
    InferenceServer,
    Live,
    ModelReady,
    ServerReady,
    Tensor,
    answer,
    max_body_bytes,
    parse,
    request_schema,
    tensors,
)
from service.api.queries import NoQuery
from service.api.responses import OVERLOADED, Problem
from service.api.routes.file_answers import BINARY
from service.api.routes.health import check
from service.api.wire.disconnects import while_there
from service.api.wire.uploads import read_body, size_ahead
from service.encoding.encoder import Encoder
from service.errors import InvalidParameter, NotFound, UnsupportedMedia
from service.mapping.spec import Array, Functions
from service.runtime.batcher import Batcher
from service.runtime.parts import Ready

router = APIRouter(prefix="/v2", tags=["inference"])

NoParameters = Annotated[NoQuery, Query()]
MISSING: Final[dict[int | str, dict[str, Any]]] = {
    404: {"model": Problem, "description": "No loaded model of the name"}
}
REQUEST_BODY: Final = {
    "required": True,
    "description": f"JSON; or JSON and behind it the tensor, where `{HEADER_LENGTH}` says how long the JSON is",
    "content": {"application/json": {"schema": request_schema()}, "application/octet-stream": BINARY},
}
RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "The outputs, as JSON or, where asked for, as bytes behind it, as in the body",
        "content": {"application/json": {"schema": {"type": "object"}}, "application/octet-stream": BINARY},
    },
    400: {"model": Problem, "description": f"A body that is no JSON, or shorter than `{HEADER_LENGTH}`"},
    408: {"model": Problem, "description": "The rest of the body does not come"},
    413: {"model": Problem, "description": "More bytes than eight images take as JSON"},
    415: {"model": Problem, "description": "A compressed body"},
    422: {"model": Problem, "description": "A faulty member, or images that are not as the model takes them"},
    429: OVERLOADED,
}


async def encoder_named(name: Annotated[str, Path(description="name of a loaded model")], runtime: Ready) -> Encoder:
    """The encoder of the path. Raises NotFound."""
    try:
        return runtime.models.named(name)
    except InvalidParameter as error:
        raise NotFound(error.detail) from error


Named = Annotated[Encoder, Depends(encoder_named)]


@router.get("")
async def server(query: NoParameters) -> InferenceServer:
    """The service, and what it has of the protocol's extensions."""
    return InferenceServer(name="hof", version=__version__, extensions=[EXTENSION])


@router.get("/health/live")
async def live(query: NoParameters) -> Live:
    """As `/health/live`."""
    return Live(live=True)


@router.get("/health/ready")
async def ready(request: Request, query: NoParameters, runtime: Ready) -> ServerReady:
    """As `/health/ready`."""
    await check(request, runtime.vitals)
    return ServerReady(ready=True)


@router.get("/models/{name}", responses=MISSING)
async def model(query: NoParameters, encoder: Named) -> InferenceModel:
    """The model's tensors; -1 stands for the batch, of which an inference takes eight images at most."""
    inputs, outputs = (
        [Tensor(name=name, datatype="FP32", shape=[-1, *shape]) for name, shape in each.items()]
        for each in tensors(encoder)
    )
    return InferenceModel(name=encoder.name, platform="onnxruntime_onnx", inputs=inputs, outputs=outputs)


@router.get("/models/{name}/ready", responses=MISSING)
async def model_ready(request: Request, query: NoParameters, encoder: Named, runtime: Ready) -> ModelReady:
    """The service is not about to stop, and this model answers."""
    part = f"model {encoder.name}"
    await check(request, {part: runtime.vitals[part]})
    return ModelReady(name=encoder.name, ready=True)


@router.post(
    "/models/{name}/infer",
    response_class=Response,
    responses=MISSING | RESPONSES,
    openapi_extra={"requestBody": REQUEST_BODY},
)
async def infer(request: Request, query: NoParameters, encoder: Named, runtime: Ready) -> Response:
    """Turn up to eight images, framed already as the model takes them, into weights. Nothing is kept.

    The output `theta` is what `/encode?store=false` gives; a model in colour has `color` beside it.
    """
    if "content-encoding" in request.headers:
        raise UnsupportedMedia("the body must not be compressed", field="Content-Encoding")
    gates, max_bytes = runtime.gates, max_body_bytes(encoder)
    with gates.uploads.admit(size_ahead(request, max_bytes)):
        body = await read_body(request, max_bytes)
        work = runtime.run(parse, body, request.headers.get(HEADER_LENGTH), encoder)
        asked, images = await while_there(request, work)
        with gates.images.admit(len(images)):
            found = await while_there(request, _encoded(runtime.batchers[encoder.name], images))
        content, headers = await while_there(request, runtime.run(answer, encoder, asked, found))
    return Response(content, headers=headers)


async def _encoded(batcher: Batcher, images: Array) -> list[Functions]:
    """The functions of each image, which the batcher may encode with those of others."""
    return await asyncio.gather(*(batcher.encode(images[i : i + 1]) for i in range(len(images))))
