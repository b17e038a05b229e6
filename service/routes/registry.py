"""List of all routers of the REST API."""

from starlette.routing import BaseRoute

from service.routes import (
    addon,
    channel,
    environments,
    events,
    examples,
    explain,
    farm,
    frames,
    health,
    hooks,
    info,
    job_history,
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
    share_links,
    shares,
    shot_files,
    sites,
    snapshots,
    tokens,
    viewport,
    workers,
)

__all__ = ["ROUTES"]

ROUTES: list[BaseRoute] = [
    route
    for module in (
        references,
        scenes,
        environments,
        jobs,
        job_history,
        share_links,
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
        channel,
        kernels,
        retention,
        health,
        login,
        openid,
        people,
        projects,
        quotas,
        tokens,
    )
    for route in module.router.routes
]
