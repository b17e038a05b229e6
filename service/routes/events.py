"""GET /api/events: server-sent events about changes of jobs, scenes and workers."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from typing import Any

from fastapi.responses import StreamingResponse
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from protocol.event_stream import EVENTS, KEEP_ALIVE, RETRY
from service.access.visit import Visit
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.redaction import redacted_slots
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.jobs.describe import jobs_out
from service.jobs.lookup import is_derived_scene
from service.models.workers import worker_out
from service.scenes.describe import scene_out
from service.store.models import Job, Scene

__all__ = ["router"]

router = api_router(tags=["events"])

SEND_EVERY_S = 0.5
CHANGES_PER_ROUND = 500  # changes per round; further ones wait for the next
KEEP_ALIVE_S = 10.0


@router.get("/api/events", response_class=StreamingResponse, responses={200: {"content": {"text/event-stream": {}}}})
async def events(farm: FarmDependency, visit: VisitDependency) -> StreamingResponse:
    """Streams events `job`, `scene` and `worker`, each with the resource as JSON; {"id", "deleted": true} if it was deleted.

    A resource that changes quickly is sent at most twice a second. After a reconnection, fetch the lists again. There are no
    events about content of projects that are not visible to you.
    """
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_stream(farm, visit), media_type="text/event-stream", headers=headers)


async def _stream(farm: Farm, visit: Visit) -> AsyncIterator[str]:
    with farm.broadcast.listen() as listener:
        yield RETRY
        spoke = sent = time.monotonic()
        while not farm.broadcast.closing:
            await listener.wait(1.0)
            now = time.monotonic()
            if listener.changed and now - sent >= SEND_EVERY_S:
                changed = list(listener.changed)[:CHANGES_PER_ROUND]
                for each in changed:
                    del listener.changed[each]
                for text in await run_in_threadpool(_event_texts, farm, visit, changed):
                    yield text
                sent = spoke = now
                if listener.changed:
                    listener.wake()
            elif listener.changed:
                await listener.collect_for(SEND_EVERY_S - (now - sent))
            elif now - spoke > KEEP_ALIVE_S:
                yield KEEP_ALIVE
                spoke = now


def _event_texts(farm: Farm, visit: Visit, changed: list[tuple[str, str]]) -> list[str]:
    view, projects = farm.engine.snapshot, farm.access.projects
    sight = visit.sight if visit.sight.everything else projects.visibility(visit.caller)  # re-evaluated: it may have changed
    with farm.sessions() as session:
        seen = [(what, id) for what, id in changed if what != "scene" or not is_derived_scene(id, session)]
        rows = session.scalars(select(Job).where(Job.id.in_([id for what, id in changed if what == "job"])))
        jobs = {job.id: job.model_dump() for job in jobs_out(list(rows), session, farm.engine, view)}
        found = [(what, id, jobs.get(id) if what == "job" else _item_data(what, id, session, farm)) for what, id in seen]
    messages = []
    for what, id, data in found:
        if what == "worker" and data is not None:
            data = {**data, "current": redacted_slots(data["current"], sight, projects)}
        elif data is not None:
            projects.cache_project("job" if what == "job" else "scene", id, data["project"])
        if what == "worker" or sight.is_visible(
            data["project"] if data else projects.cached_project("job" if what == "job" else "scene", id)
        ):
            messages.append((what, id, data))
    return [EVENTS[what](id, data).to_text() for what, id, data in messages]


def _item_data(what: str, id: str, session: Session, farm: Farm) -> dict[str, Any] | None:
    """Returns a scene or worker as JSON data; None if it no longer exists."""
    if what == "scene":
        scene = session.get(Scene, id)
        return scene_out(scene, farm.engine).model_dump() if scene else None
    view = farm.engine.snapshot
    report = view.roster.reports.get(id)
    return worker_out(report, view.roster.orders.get(id), view).model_dump() if report else None
