"""Types of path parameters in routes."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path

from renderer.frames import MAX_FRAME

__all__ = ["Number"]

Number = Annotated[float, Path(ge=0, le=MAX_FRAME, multiple_of=0.5, allow_inf_nan=False, description="the frame; a still is 0")]
