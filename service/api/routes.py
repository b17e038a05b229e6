"""The REST API: one router a resource."""

from fastapi import APIRouter

from service.api import (
    environments,
    events,
    examples,
    farm,
    frames,
    health,
    info,
    jobs,
    kernels,
    live,
    retention,
    scenes,
    shot_files,
    viewport,
    workers,
)

__all__ = ["router"]

router = APIRouter()
for module in (
    scenes,
    environments,
    jobs,
    frames,
    shot_files,
    live,
    viewport,
    workers,
    events,
    examples,
    info,
    farm,
    kernels,
    retention,
    health,
):
    router.include_router(module.router)
