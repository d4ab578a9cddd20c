"""The application: what is opened at start, how errors answer, which calls there are."""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import partial
from typing import Any, Final

from fastapi import FastAPI, Request
from starlette.responses import Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from service import __version__
from service.api import problems
from service.api.middleware.access import Access
from service.api.middleware.observe import Observed, Templates
from service.api.middleware.security_headers import SecureHeaders, with_cors
from service.api.openapi import openapi_text
from service.api.responses import RETRY_AFTER, Problem
from service.api.routes import compose, encode, health, inference, mesh, metrics, objects, viewer
from service.api.wire.disconnects import Patience
from service.encoding.decode import ignore_metadata_warnings
from service.encoding.matting import Matting
from service.encoding.registry import Models
from service.errors import InvalidParameter
from service.mapping import compiled
from service.mapping.sampler import hold_blas_to_one_thread
from service.runtime.parts import Runtime
from service.settings import Settings
from service.storage.store import Store
from service.telemetry.metrics import Metrics
from service.telemetry.tracing import telemetry

DESCRIPTION: Final = """\
A photo goes in; a function comes out. The image encoder looks at one RGB image and outputs theta, the weights of a
tiny mapping network f; f^k of the points of a unit ball is the object, at any resolution, as often as you ask.

Objects are in one frame: right-handed, +Y up, front +Z, the longest side 1. Errors are `application/problem+json`
(RFC 9457); unknown parameters are errors."""

RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    422: {"model": Problem, "description": "A parameter is unknown, of the wrong type or out of range"},
    503: {"model": Problem, "description": "The service is starting or stopping", "headers": RETRY_AFTER},
}


def create_app(settings: Settings) -> FastAPI:
    """The service as an ASGI application; nothing is opened before it starts."""
    app = Service(
        title="HOF",
        summary="Higher-Order Function networks as a service",
        description=DESCRIPTION,
        version=__version__,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        openapi_url=None,  # served below, byte for byte as committed
        redirect_slashes=False,
        lifespan=partial(_lifespan, settings),
        telemetry=telemetry(),
    )
    app.state.settings = settings
    app.state.metrics = Metrics()
    app.state.runtime = None
    problems.install(app)
    app.add_middleware(OnceEach)
    app.add_middleware(HeadAsGet)
    app.add_middleware(Patience, seconds=settings.client_timeout_s)
    for module in (encode, compose, objects, mesh, health, inference, metrics):
        app.include_router(module.router, responses=RESPONSES)
    _serve_schema(app)
    app.router.routes.extend(viewer.routes)
    return app


class Service(FastAPI):
    """FastAPI within the layers that see every request, and every answer: those of faults, too."""

    def build_middleware_stack(self) -> ASGIApp:
        """The layers, the innermost first. Raises InvalidKeys."""
        settings: Settings = self.state.settings
        layers: ASGIApp = Access(super().build_middleware_stack(), settings)
        if settings.cors_origins:
            layers = with_cors(layers, settings.cors_origins.split(","))
        templates = [*self.openapi()["paths"], *(route.path for route in self.routes if isinstance(route, Route))]
        mounts = (f"{route.path}/{{path:path}}" for route in self.routes if isinstance(route, Mount))
        return Observed(SecureHeaders(layers), self.state.metrics, Templates([*templates, *mounts]))


@asynccontextmanager
async def _lifespan(settings: Settings, app: FastAPI) -> AsyncIterator[None]:
    """Open the models and the store, run one inference of each encoder, and serve; close them in the end."""
    with ThreadPoolExecutor(settings.threads, thread_name_prefix="hof") as executor:
        models = await asyncio.to_thread(Models.open, settings.model, settings.threads)
        await asyncio.to_thread(models.warm_up)
        matting = await asyncio.to_thread(Matting.of, settings.matting_model, settings.threads)
        await asyncio.to_thread(compiled.load)
        hold_blas_to_one_thread()
        ignore_metadata_warnings()
        store = await Store.open(settings.database_url)
        app.state.runtime = Runtime(settings, models, matting, store, executor, app.state.metrics)
        try:
            yield
        finally:
            app.state.runtime = None
            await store.close()


def _serve_schema(app: FastAPI) -> None:
    """/openapi.json, byte for byte as committed."""
    text = openapi_text(app)

    async def schema(request: Request) -> Response:
        return Response(text, media_type="application/json")

    app.add_route("/openapi.json", schema, include_in_schema=False)


class HeadAsGet:
    """HEAD wherever there is GET: the same answer, whose body the server then leaves out.

    ``scope["hof.head"]`` tells a call whose body costs something that nobody will see it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] == "http" and scope["method"] == "HEAD":
            scope = {**scope, "method": "GET", "hof.head": True}
        await self._app(scope, receive, send)


class OnceEach:
    """Refuses a call that gives a parameter twice: to drop one silently helps nobody."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it."""
        if scope["type"] == "http" and b"&" in scope["query_string"]:
            names = [name for name, _ in Request(scope).query_params.multi_items()]
            repeated = next((name for name, count in Counter(names).items() if count > 1), None)
            if repeated is not None:
                refusal = problems.respond(InvalidParameter("a parameter may be given once", field=repeated[:64]))
                await refusal(scope, receive, send)
                return
        await self._app(scope, receive, send)
