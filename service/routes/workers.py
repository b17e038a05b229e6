"""/api/workers: lists, changes and pauses workers."""

from __future__ import annotations

from typing import Any

import redis

from renderer.sentences import Sentence
from service.errors import Conflict, NotFound, Unavailable
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.redaction import REDACTED_SLOT, redacted_slots
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.models.workers import WorkerOut, WorkerPatch, worker_out
from service.scheduling.faults.redis_errors import redis_unavailable
from service.scheduling.fleet.workers import PAUSED_BY_USER
from service.store.models import WorkerTerms

__all__ = ["router"]

router = api_router(prefix="/api/workers", tags=["workers"])


@router.get("", response_model=list[WorkerOut])
def list_workers(farm: FarmDependency, visit: VisitDependency) -> list[WorkerOut]:
    """Lists the connected workers by name: slots, processor, speed, and the current work of each slot.

    Work for a project that is not visible to you is shown as {"hidden": true}, and so is all work to a worker.
    """
    view = farm.engine.snapshot
    roster = view.roster
    found = [worker_out(roster.reports[name], roster.orders.get(name), view) for name in sorted(roster.reports)]
    is_worker = visit.caller is not None and visit.caller.is_worker
    for worker in found:
        if is_worker:  # the ids of batches are what lets a worker report about them
            worker.current = [REDACTED_SLOT if slot else slot for slot in worker.current]
        else:
            worker.current = redacted_slots(worker.current, visit.sight, farm.access.projects)
    return found


@router.patch("/{name:path}", response_model=WorkerOut)  # a worker's name may contain slashes, as in rack/3
def change_worker(name: str, change: WorkerPatch, farm: FarmDependency) -> WorkerOut:
    """Pauses a worker, which finishes its current work but takes no more, or resumes one, even one that was quarantined.

    Changes of hours, limits and nice level reach the worker within two seconds. They are stored under its name, also for later
    connections. The response contains the worker's present values.
    """
    roster = farm.engine.snapshot.roster
    report = roster.reports.get(name)
    if report is None:
        raise _worker_not_found(name)
    if change.terms:
        if name not in roster.offers:
            raise Conflict(
                Sentence(
                    "worker-only-pausable",
                    "The worker {name} is of an older release and can only be paused. Run this release there.",
                    name=name,
                )
            )
        _request_terms(name, change.terms, farm)
    why = roster.orders.get(name)
    if change.state is not None:
        why = None if change.state == "running" else PAUSED_BY_USER
        try:
            farm.engine.set_paused(name, why)
        except redis.RedisError as error:
            raise redis_unavailable(error) from None
    return worker_out(report, why, farm.engine.snapshot)


def _request_terms(name: str, terms: dict[str, Any], farm: Farm) -> None:
    with farm.sessions.begin() as session:
        row = session.get(WorkerTerms, name, with_for_update=True)
        asked = {**(row.terms if row is not None else {}), **terms}
        session.merge(WorkerTerms(name=name, terms={key: value for key, value in asked.items() if value is not None}))
    farm.engine.record_change("terms", "")


@router.get("/{name:path}/log")
def get_worker_log(name: str, farm: FarmDependency) -> list[str]:
    """Returns the last lines of a worker's log, oldest first. The worker sends them on request, which takes a second or two."""
    if name not in farm.engine.snapshot.roster.reports:
        raise _worker_not_found(name)
    try:
        lines = farm.engine.worker_log(name)
    except redis.RedisError as error:
        raise redis_unavailable(error) from None
    if lines is None:
        raise Unavailable(
            Sentence(
                "worker-log-unavailable",
                "The worker did not send its log: it is still starting, is of an older release, or hangs. Try "
                "again, or restart it.",
            )
        )
    return lines


def _worker_not_found(name: str) -> NotFound:
    return NotFound(
        Sentence(
            "worker-not-found",
            "There is no worker {name}. GET /api/workers lists those that are connected.",
            name=repr(name[:60]),
        )
    )
