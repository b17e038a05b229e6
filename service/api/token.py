"""Who may work for this farm: workers show its token."""

from __future__ import annotations

import secrets
from typing import Annotated

from fastapi import Header

from service.api.problem import Problem
from service.farm import FarmDependency

__all__ = ["check_token"]


async def check_token(farm: FarmDependency, authorization: Annotated[str, Header()] = "") -> None:
    """Let only those in who show the farm's token."""
    if not secrets.compare_digest(authorization.encode(), f"Bearer {farm.settings.token}".encode()):
        raise Problem(
            401,
            "Workers show the farm's token: Authorization: Bearer TOKEN. `rayfarm up` prints it.",
            headers={"WWW-Authenticate": "Bearer"},
        )
