"""/healthz, /readyz, /metrics: monitoring of the service."""

from __future__ import annotations

import anyio
import anyio.to_thread
from fastapi import Response
from prometheus_client import CONTENT_TYPE_LATEST
from sqlalchemy import text

from renderer.sentences import Sentence
from service.errors import Unavailable
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.routes import metrics

__all__ = ["router"]

router = api_router(tags=["health"])

DATABASE_TIMEOUT_S = 2.0  # seconds, timeout of the database check


@router.get("/healthz")
async def healthz(farm: FarmDependency) -> dict[str, str]:
    """Reports whether the process is healthy; if not, restart it. Uses no thread, database or disk, so it never blocks."""
    if not farm.engine.is_alive:
        raise Unavailable(Sentence("engine-ended", "The scheduler has stopped. Restart the service."))
    return {"status": "ok"}


@router.get("/readyz")
async def readyz(farm: FarmDependency) -> dict[str, str]:
    """Reports whether the service can work now: whether its database, films and Redis respond."""
    try:
        with anyio.fail_after(DATABASE_TIMEOUT_S):
            await anyio.to_thread.run_sync(_ask_database, farm, limiter=farm.readiness, abandon_on_cancel=True)
    except Exception as error:
        raise Unavailable(
            Sentence(
                "database-health-failed",
                "The database does not answer ({error}). Check RAYFARM_DATABASE_URL.",
                error=type(error).__name__,
            )
        ) from error
    if (why := farm.engine.snapshot.unready_reason) is not None:
        raise Unavailable(why)
    return {"status": "ready"}


def _ask_database(farm: Farm) -> None:
    with farm.sessions() as session:
        session.execute(text("SELECT 1"))


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
def get_metrics(farm: FarmDependency) -> Response:
    """Returns metrics for Prometheus."""
    return Response(metrics.render(farm), media_type=CONTENT_TYPE_LATEST)
