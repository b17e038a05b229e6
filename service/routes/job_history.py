"""/api/jobs/{id}: a job's log, and its history: progress over time, and events."""

from __future__ import annotations

import hashlib

from fastapi import Request, Response
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, Field

from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.jobs.lookup import find_job
from service.scheduling.jobs.history import History

__all__ = ["router"]

router = api_router(prefix="/api/jobs", tags=["jobs"])


class HistoryPoint(BaseModel):
    """Samples and noise of a job at one moment of rendering."""

    seconds: float = Field(description="seconds of rendering, without pauses")
    spp: float = Field(description="samples per pixel; of a shot the sum over its frames")
    noise: float | None = Field(description="relative standard error; of a shot the maximum over its frames; null while unknown")


class HistoryEvent(BaseModel):
    """An event in a job's history."""

    at: float = Field(description="Unix time in seconds")
    kind: str = Field(
        description="begun, picture (every tile has a sample), worker, left, paused, resumed, lost, failed, healed, late, in-time"
    )
    words: str = Field(description="name or reason")


class HistoryOut(BaseModel):
    """The history of a job; at most some hundred points and events."""

    points: list[HistoryPoint] = Field(description="samples and noise over time")
    events: list[HistoryEvent] = Field(description="what happened, in order")


@router.get("/{id}/log", response_class=PlainTextResponse)
def job_log(id: str, farm: FarmDependency, request: Request) -> Response:
    """Returns the log of a job: preparation of its scene; batches dispatched, returned, lost and failed; and their workers.

    The latest 256 kB. Lines begin with the time (UTC); errors are followed by the last lines of their tracebacks, indented.
    """
    find_job(id, farm)
    text = farm.engine.logs.text(id)
    tag = f'"{hashlib.sha256(text).hexdigest()[:32]}"'
    headers = {"ETag": tag, "Cache-Control": "no-cache"}
    if tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return PlainTextResponse(text, headers=headers)


@router.get("/{id}/history", response_model=HistoryOut)
def job_history(id: str, farm: FarmDependency) -> HistoryOut:
    """Returns the history of a job: noise and samples over rendering time, and its events."""
    job = find_job(id, farm)
    size = job.settings or {}
    pixels = max(int(size.get("width", 1)) * int(size.get("height", 1)), 1)
    history = History.parse(farm.records.history(id))
    return HistoryOut(
        points=[HistoryPoint(seconds=s or 0.0, spp=(n or 0.0) / pixels, noise=e) for s, n, e in history.points],
        events=[HistoryEvent(at=at, kind=kind, words=words) for at, kind, words in history.events],
    )
