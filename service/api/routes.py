"""The REST API: one router per resource."""

from fastapi import APIRouter

from service.api import (
    addon,
    environments,
    events,
    examples,
    explain,
    farm,
    frames,
    health,
    hooks,
    info,
    jobs,
    kernels,
    live,
    login,
    openid,
    people,
    projects,
    quotas,
    references,
    retention,
    scenes,
    shares,
    shot_files,
    sites,
    snapshots,
    tokens,
    viewport,
    workers,
)

__all__ = ["router"]

router = APIRouter()
for module in (
    references,
    scenes,
    environments,
    jobs,
    frames,
    explain,
    shot_files,
    snapshots,
    live,
    viewport,
    workers,
    sites,
    shares,
    events,
    hooks,
    examples,
    info,
    addon,
    farm,
    kernels,
    retention,
    health,
    login,
    openid,
    people,
    projects,
    quotas,
    tokens,
):
    router.include_router(module.router)
