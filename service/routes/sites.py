"""/api/sites: the sites of the farm. At a site, a reducer adds up the results of the site's machines before sending them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from protocol.site import SITE
from service.http.farm import FarmDependency
from service.http.routers import api_router

__all__ = ["router"]

router = api_router(prefix="/api/sites", tags=["workers"])


class SiteOut(BaseModel):
    """A site's reducer, with its counts since its start, as the reducer reports them."""

    name: str = Field(description="name of the site")
    host: str = Field(description="name of its machine")
    started: float = Field(description="Unix time of its start")
    workers: list[str] = Field(description="names of the site's workers")
    results: int = Field(description="results received from its workers")
    sent: int = Field(description="summed results sent to the farm")
    bytes_in: int = Field(description="bytes received from its workers")
    bytes_out: int = Field(description="bytes sent to the farm")
    batches_waiting: int = Field(description="batches that are summed but not sent yet")


@router.get("", response_model=list[SiteOut])
def list_sites(farm: FarmDependency) -> list[SiteOut]:
    """Lists the sites with a reducer (`rayfarm site`), by name."""
    roster = farm.engine.snapshot.roster
    found = []
    for name, site in sorted(roster.sites.items()):
        workers = sorted(worker for worker, offer in roster.offers.items() if f"{SITE}{name}" in offer.tags)
        counts = {key: getattr(site, key) for key in ("results", "sent", "bytes_in", "bytes_out")}
        about: dict[str, Any] = {"name": name, "host": site.host, "started": site.started, "workers": workers}
        found.append(SiteOut(**about, **counts, batches_waiting=len(site.in_hand)))
    return found
