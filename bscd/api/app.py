"""The API as an ASGI application around one daemon."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from typing import Any

from fastapi import Depends, FastAPI, Response
from fastapi.openapi.utils import get_openapi
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry

from bscd.api import metrics
from bscd.api.gatekeeping import Audit, OwnHost, RateLimit, SizeLimit
from bscd.api.problems import PROBLEMS, Problem, add_handlers
from bscd.api.refusals import Refusals
from bscd.api.routes import camera, control, events, files, jobs, status
from bscd.api.security import BEARER, OPERATOR, Gate, Viewer, is_loopback
from bscd.daemon.daemon import Daemon
from bscd.version import __version__

PREFIX = "/api/v1"

_ESTOPS = 4


def create_app(daemon: Daemon) -> FastAPI:
    """The application; the daemon's owner closes the daemon."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        yield
        app.state.closing.set()
        app.state.estop_threads.shutdown(wait=False)

    app = FastAPI(
        title="bscd",
        version=__version__,
        summary="Measurement daemon of a biprism single-camera stereo-DIC rig",
        docs_url=None,  # they load from another host
        redoc_url=None,
        openapi_url=f"{PREFIX}/openapi.json",
        lifespan=lifespan,
        separate_input_output_schemas=False,
    )
    app.state.daemon, app.state.gate = daemon, Gate(daemon)
    app.state.closing = asyncio.Event()
    app.state.estop_threads = ThreadPoolExecutor(_ESTOPS, thread_name_prefix="e-stop request")
    add_handlers(app)
    shown = [Depends(BEARER), Depends(OPERATOR)]
    for each in (status.router, jobs.router, control.router, files.router, events.router, camera.router):
        app.include_router(each, prefix=PREFIX, responses=PROBLEMS, dependencies=shown)
    app.include_router(status.health)
    registry = CollectorRegistry()
    registry.register(metrics.RigFigures(daemon))

    @app.get("/metrics", tags=["health"], response_class=Response, responses={**_TEXT, **PROBLEMS}, dependencies=shown)
    def figures(who: Viewer) -> Response:
        """Figures for Prometheus."""
        return Response(metrics.text_of(registry), media_type=CONTENT_TYPE_LATEST)

    app.add_middleware(SizeLimit, most_bytes=daemon.settings.request_limit_bytes)
    if is_loopback(daemon.settings.host):
        app.add_middleware(OwnHost)
    refusals = Refusals(daemon.journal)
    app.add_middleware(Audit, daemon=daemon, refusals=refusals)
    app.add_middleware(RateLimit, requests_per_s=daemon.settings.requests_per_s, refusals=refusals)
    app.add_middleware(metrics.RequestFigures, registry=registry)
    app.openapi = lambda: _openapi(app)
    return app


_TEXT: dict[int | str, dict[str, Any]] = {200: {"description": "in its text format", "content": {"text/plain": {}}}}


def _openapi(app: FastAPI) -> dict[str, Any]:
    if app.openapi_schema is None:
        made = get_openapi(title=app.title, version="1", summary=app.summary, routes=app.routes)
        schemas = made["components"]["schemas"]
        for one in (Problem, control.EStopOrder):
            schemas[one.__name__] = one.model_json_schema(ref_template="#/components/schemas/{model}")
        for unused in ("HTTPValidationError", "ValidationError"):
            schemas.pop(unused, None)
        app.openapi_schema = made
    return app.openapi_schema
