"""GET /api/joining: how workers join this farm."""

from __future__ import annotations

from dataclasses import asdict

from pydantic import BaseModel, Field

from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.joining import joining

__all__ = ["router"]

router = api_router(tags=["workers"])


class JoiningOut(BaseModel):
    """Commands, for a POSIX shell, with which workers join this farm as it was started."""

    url: str | None = Field(description="the farm's address for other machines; null if the settings name none that they reach")
    start: str | None = Field(description="starts the farm for other machines; null if they reach it, or it is unknown")
    token: str = Field(description="run on the farm's machine: writes a new worker's token to NAME.token")
    here: str = Field(description="run on the farm's machine: starts a worker there")
    program: str = Field(description="the program on other machines: `python3 farm.py` in a clone, or `rayfarm`")


@router.get("/api/joining", response_model=JoiningOut)
def get_joining(farm: FarmDependency) -> JoiningOut:
    """Returns the commands with which workers join this farm."""
    return JoiningOut(**asdict(joining(farm.settings)))
