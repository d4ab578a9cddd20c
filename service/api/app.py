"""The application: routes, middleware, and the parts that are opened at start and closed at the end."""

import asyncio
import logging
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import cache, partial
from typing import Final

from fastapi import APIRouter, FastAPI, Request
from fastapi.routing import APIRoute
from fastapi.telemetry import TelemetryConfig
from starlette.responses import Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp

from service import __version__
from service.api import problems
from service.api.admission import declared_gates
from service.api.middleware.access import Access
from service.api.middleware.foreign_pages import RefuseForeignPages
from service.api.middleware.head import HeadAsGet
from service.api.middleware.observe import Observe, Templates
from service.api.middleware.pieces import SendInPieces
from service.api.middleware.query import CheckQuery
from service.api.middleware.security_headers import SecurityHeaders, with_cors
from service.api.middleware.slow_clients import SlowClientTimeout
from service.api.openapi import openapi_text
from service.api.responses.errors import RETRY_AFTER, Problem, Responses
from service.api.routes import (
    compose,
    encode,
    health,
    imports,
    inference,
    mesh,
    metrics,
    models,
    objects,
    paths,
    pictures,
    points,
    viewer,
    weights,
)
from service.encoding.decode import configure_pillow
from service.mapping.sampler import hold_blas_to_one_thread
from service.runtime.admission import Gates
from service.runtime.networks import Networks
from service.runtime.parts import Runtime
from service.settings import Settings
from service.storage.store import Store
from service.telemetry import tracing
from service.telemetry.metrics import Metrics

logger: Final = logging.getLogger("hof")

DESCRIPTION: Final = """\
A photo goes in; a function comes out. The image encoder looks at one RGB image and outputs theta, the weights of a
tiny mapping network f; f^k of the points of a unit ball is the object, at any resolution, as often as needed.

Objects are in one frame: right-handed, +Y up, front +Z, centered, the longest side 1. Errors are
`application/problem+json` (RFC 9457); unknown parameters are errors."""

ROUTERS: Final = (
    encode.router,
    compose.router,
    objects.router,
    imports.router,
    points.router,
    weights.router,
    mesh.router,
    pictures.router,
    paths.router,
    health.router,
    models.router,
    inference.router,
    metrics.router,
)

RESPONSES: Final[Responses] = {
    422: {"model": Problem, "description": "A parameter is unknown, of the wrong type or out of range"},
    503: {
        "model": Problem,
        "description": "The service is starting or stopping, or its database cannot be used at present",
        "headers": RETRY_AFTER,
    },
}


def create_app(settings: Settings, networks: Networks | None = None) -> FastAPI:
    """Return the service as an ASGI application; nothing is opened before it starts.

    Parameters
    ----------
    networks : those of the settings, if they are open already.
    """
    app = Service(
        title="HOF",
        summary="Higher-Order Function networks as a service",
        description=DESCRIPTION,
        version=__version__,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        openapi_url=None,  # served below, byte for byte as committed
        redirect_slashes=False,
        lifespan=partial(_lifespan, settings, networks),
        telemetry=_telemetry(),
    )
    app.state.settings = settings
    app.state.metrics = Metrics()
    app.state.gates = Gates.of(settings)
    app.state.runtime = None
    problems.install(app)
    app.add_middleware(SendInPieces, gate=app.state.gates.answers)
    app.add_middleware(CheckQuery)
    app.add_middleware(HeadAsGet)
    app.add_middleware(SlowClientTimeout, seconds=settings.client_timeout_s)
    for router in ROUTERS:
        app.include_router(router, responses=RESPONSES)
    _serve_directly(app, encode.router)
    _serve_schema(app)
    app.router.routes.extend(viewer.routes)
    return app


class Service(FastAPI):
    """FastAPI wrapped in the outer middleware, which also sees error responses."""

    def build_middleware_stack(self) -> ASGIApp:
        """Return the middleware around the application. Raises InvalidKeys."""
        settings: Settings = self.state.settings
        routes = [route for router in ROUTERS for route in router.routes]
        gates = declared_gates(routes, self.state.gates)
        layers: ASGIApp = Access(super().build_middleware_stack(), settings, gates)
        if settings.api_keys_file is None:
            layers = RefuseForeignPages(layers, settings)
        if settings.cors_origins:
            layers = with_cors(layers, settings.cors_origins.split(","))
        templates = [route.path for route in (*routes, *self.routes) if isinstance(route, Route)]
        mounts = (f"{route.path}/{{path:path}}" for route in self.routes if isinstance(route, Mount))
        return Observe(SecurityHeaders(layers), self.state.metrics, Templates([*templates, *mounts]))


def _telemetry() -> TelemetryConfig:
    """Return FastAPI's configuration: spans only; metrics are at /metrics and errors in the log."""
    has_extra = tracing.is_installed()
    if tracing.is_wanted() and not has_extra:
        logger.warning(
            "OTEL_EXPORTER_OTLP_ENDPOINT is set, but traces need an extra: pip install '.[otel]' in the source folder"
        )
    return {"auto_configure": has_extra, "tracing": has_extra, "metrics": False, "logs": False}


@asynccontextmanager
async def _lifespan(settings: Settings, networks: Networks | None, app: FastAPI) -> AsyncIterator[None]:
    """Open the networks and the store and run one inference of each encoder; close the store in the end."""
    with ThreadPoolExecutor(settings.threads, thread_name_prefix="hof") as executor:
        opened = await asyncio.to_thread(_open_warm, settings, networks)
        hold_blas_to_one_thread()
        configure_pillow()
        store = await Store.open_once_reachable(
            settings.database_url, settings.database_timeout_s, settings.database_connections
        )
        models, matting = opened.models, opened.matting
        app.state.runtime = Runtime(settings, models, matting, store, executor, app.state.metrics, app.state.gates)
        try:
            yield
        finally:
            app.state.runtime = None
            await store.close()


def _open_warm(settings: Settings, networks: Networks | None) -> Networks:
    """Return the networks, opened and tried."""
    opened = networks or Networks.open(settings)
    opened.warm_up()
    return opened


def _serve_directly(app: FastAPI, router: APIRouter) -> None:
    """Serve a router's endpoints by plain routes, ahead of FastAPI's, which describe them in openapi.json.

    For endpoints that take the request alone: to prepare nothing took FastAPI a sixth of a repeated photo's time.
    """
    routes = [route for route in router.routes if isinstance(route, APIRoute)]
    app.router.routes[:0] = [Route(route.path, route.endpoint, methods=route.methods) for route in routes]


def _serve_schema(app: FastAPI) -> None:
    """Serve /openapi.json, byte for byte as committed."""
    text = cache(lambda: openapi_text(app))  # written when it is first asked for: that takes a tenth of a second

    async def schema(request: Request) -> Response:
        return Response(text(), media_type="application/json")

    app.add_route("/openapi.json", schema, include_in_schema=False)
