"""/healthz, /readyz, /metrics: for whoever watches the service."""

from __future__ import annotations

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST
from sqlalchemy import text

from service.api import metrics
from service.api.problem import Problem
from service.farm import FarmDependency

__all__ = ["router"]

router = APIRouter(tags=["health"])


@router.get("/healthz")
def healthz(farm: FarmDependency) -> dict[str, str]:
    """Whether the process is sane; if not, restart it."""
    if not farm.engine.is_alive:
        raise Problem(503, "The engine has ended. Restart the service.")
    return {"status": "ok"}


@router.get("/readyz")
def readyz(farm: FarmDependency) -> dict[str, str]:
    """Whether the service can work now: its database, its films and Redis answer."""
    try:
        with farm.sessions() as session:
            session.execute(text("SELECT 1"))
    except Exception as error:
        raise Problem(503, f"The database does not answer ({type(error).__name__}). Look at RAYFARM_DATABASE_URL.") from error
    if (why := farm.engine.snapshot.not_ready) is not None:
        raise Problem(503, why)
    return {"status": "ready"}


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
def get_metrics(farm: FarmDependency) -> Response:
    """Numbers for Prometheus."""
    return Response(metrics.render(farm), media_type=CONTENT_TYPE_LATEST)
