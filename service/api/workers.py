"""/api/workers: who renders, and who is to pause."""

from __future__ import annotations

import redis
from fastapi import APIRouter

from service.api.describe import worker_out
from service.api.schemas import WorkerOut, WorkerPatch
from service.errors import NotFound, Unavailable
from service.farm import FarmDependency

__all__ = ["router"]

router = APIRouter(prefix="/api/workers", tags=["workers"])


@router.get("", response_model=list[WorkerOut])
def list_workers(farm: FarmDependency) -> list[WorkerOut]:
    """The workers that are connected, by name: slots, processor, speed, and what each slot does now."""
    roster = farm.engine.snapshot.roster
    return [worker_out(roster.reports[name], roster.orders.get(name)) for name in sorted(roster.reports)]


@router.patch("/{name}", response_model=WorkerOut)
def change_worker(name: str, change: WorkerPatch, farm: FarmDependency) -> WorkerOut:
    """Pause a worker: it finishes what it has in hand and takes no more. Or let it go on, also one that was set aside."""
    report = farm.engine.snapshot.roster.reports.get(name)
    if report is None:
        raise NotFound(f"There is no worker {name[:60]!r}. GET /api/workers lists those that are connected.")
    why = None if change.state == "running" else "Paused by a person."
    try:
        farm.engine.order(name, why)
    except redis.RedisError as error:
        raise Unavailable(f"Redis does not answer ({error}). Try again when it does.") from None
    return worker_out(report, why)
