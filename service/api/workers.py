"""GET /api/workers: who renders."""

from __future__ import annotations

from fastapi import APIRouter

from service.describe import worker_out
from service.farm import FarmDependency
from service.schemas import WorkerOut

__all__ = ["router"]

router = APIRouter(prefix="/api/workers", tags=["workers"])


@router.get("", response_model=list[WorkerOut])
def list_workers(farm: FarmDependency) -> list[WorkerOut]:
    """The workers that are connected, by name: slots, processor, speed, and what each slot does now."""
    reports = farm.engine.workers.reports
    return [worker_out(reports[name]) for name in sorted(reports)]
