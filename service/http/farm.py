"""The farm, as a dependency of routes."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from service.farm import Farm

__all__ = ["FarmDependency"]


async def get_farm(connection: HTTPConnection) -> Farm:
    """Returns the farm of the application that handles the connection."""
    farm: Farm = connection.app.state.farm
    return farm


FarmDependency = Annotated[Farm, Depends(get_farm)]
