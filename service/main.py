"""The FastAPI application that `python -m service` serves."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import signal
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from types import FrameType
from typing import Any

from fastapi import FastAPI
from starlette.responses import RedirectResponse

from renderer import __version__
from renderer.printable import LogRecord, printable
from service.errors import StartupError
from service.farm import Farm
from service.guides import Guides
from service.health_port import HealthPort
from service.http import problems
from service.http.client_address import ClientAddress
from service.http.compression import CompressionMiddleware
from service.http.gate import AuthorizationMiddleware
from service.http.lingering_close import LingeringClose
from service.http.security import SecurityMiddleware
from service.http.standby_requests import StandbyMiddleware
from service.locations import shipped_folder
from service.pages import Pages, WebPages
from service.process_lifecycle import REFUSES_TO_START, ServiceLifecycle
from service.routes import registry
from service.settings import Settings
from service.watching.allocator import use_one_heap
from telemetry import tracing
from telemetry.log_lines import as_json, uses_json

__all__ = ["create_app"]

DOCS = Path(__file__).parent / "docs_page"
SHARE_PAGE = Path(__file__).parent / "share_page"


def create_app(settings: Settings | None = None) -> FastAPI:
    """Returns the service as an ASGI application. settings: None: read from the environment."""
    try:
        settings = settings or Settings.read()
    except StartupError as error:
        print(printable(f"ERROR:    {error}"), file=sys.stderr)
        sys.exit(REFUSES_TO_START)
    logging.setLogRecordFactory(LogRecord)
    if uses_json():
        as_json("service")

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        use_one_heap()

        def take_over(farm: Farm) -> None:
            app.state.farm = farm

        life = app.state.life = ServiceLifecycle(settings, take_over)
        health = None
        try:
            if settings.health_port:
                health = HealthPort(settings.host, settings.health_port, lambda: life.is_alive)
            await life.begin()
        except StartupError as error:
            app.state.refusal = str(error)
            raise
        if health is not None:
            health.start(asyncio.get_running_loop())
        gc.enable()
        gc.freeze()  # excludes modules and routes from collections: each full collection took 100 ms, while all requests waited
        with _end_streams_on_shutdown(life.close_streams):
            try:
                yield
            finally:
                gc.unfreeze()
                if health is not None:
                    health.stop()
                await life.stop()
                await asyncio.to_thread(tracing.stop_tracing)

    app = FastAPI(
        title="Rayfarm",
        version=__version__,
        description="Upload a scene, ask for a picture, watch it grow.",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        routes=registry.ROUTES,
    )
    problems.install(app)
    app.add_api_route("/docs", lambda: RedirectResponse("/docs/"), include_in_schema=False)
    app.mount("/shared", Pages(directory=SHARE_PAGE, html=True), name="shared")
    app.mount("/docs/guides", Guides(shipped_folder("docs"), DOCS / "guide.html"), name="guides")
    app.mount("/docs", Pages(directory=DOCS, html=True), name="docs")
    if settings.web.is_dir():
        app.mount("/", WebPages(settings.web), name="web")
    else:
        app.add_api_route("/", lambda: RedirectResponse("/docs/"), include_in_schema=False)
    app.add_middleware(CompressionMiddleware)
    app.add_middleware(AuthorizationMiddleware)
    app.add_middleware(StandbyMiddleware, settings=settings)
    app.add_middleware(SecurityMiddleware, settings=settings)  # checks host, origin and size of each request
    app.add_middleware(ClientAddress, settings=settings)  # before these: they use the client's address and scheme
    app.add_middleware(LingeringClose)
    return app


@contextlib.contextmanager
def _end_streams_on_shutdown(close: Callable[[], None]) -> Any:
    """Context manager that ends event streams when the server gets a stop signal.

    The server waits for open responses, and event streams would never end. close: ends the streams; called in the signal
    handler.
    """
    previous: dict[signal.Signals, Any] = {}

    def close_streams(number: int, frame: FrameType | None) -> None:
        close()
        before = previous[signal.Signals(number)]
        if callable(before):
            before(number, frame)

    with contextlib.suppress(ValueError):  # not in the main thread: then the caller that runs the server stops it
        for each in (signal.SIGINT, signal.SIGTERM):
            previous[each] = signal.getsignal(each)
            signal.signal(each, close_streams)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            for each, handler in previous.items():
                signal.signal(each, handler)
