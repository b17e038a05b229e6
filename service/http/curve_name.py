"""The query parameter `tonemap` of pictures."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query

from renderer.image import tonemap

__all__ = ["CurveName"]

CurveName = Annotated[
    str,
    Query(
        alias="tonemap",
        max_length=400,
        description=f"for png and jpg: {', '.join(tonemap.CURVES)}, or a view of GET /api/info as ocio:DISPLAY/VIEW",
    ),
]
