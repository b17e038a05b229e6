"""The request for one picture, and the events during its rendering. Independent of Blender."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .protocol.pictures import Words

__all__ = ["Failed", "FinishedPicture", "Light", "RenderRequest", "StatusMessage", "TileUpdate"]


@dataclass(frozen=True)
class Light:
    """The environment light: a radiance, a picture (name and content), or that of the scene file."""

    color: list[float] | None = None
    image: tuple[str, bytes | Path] | None = None
    is_own: bool = False  # the scene file's
    strength: float = 1.0
    rotation: float = 0.0


@dataclass(frozen=True)
class RenderRequest:
    """The request for a picture.

    files: of its scene, by name. request: as POST /api/jobs takes it, without scene and light. planes: AOVs.
    """

    files: dict[str, bytes | Path]
    main: str
    title: str
    light: Light
    request: dict[str, Any]
    planes: tuple[str, ...] = ()
    denoise: bool = False


@dataclass(frozen=True)
class StatusMessage:
    """A status message. progress: 0 to 1; None if unknown."""

    text: str
    progress: float | None = None


@dataclass(frozen=True)
class TileUpdate:
    """A tile with more samples; x and y from the picture's upper left corner. words: (h, w) RGB9E5."""

    x: int
    y: int
    words: Words


@dataclass(frozen=True)
class FinishedPicture:
    """The finished picture: channels by their EXR names, each (h, w) float32, rows from the top."""

    channels: dict[str, npt.NDArray[np.float32]]
    job: str
    sent_bytes: int
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Failed:
    """The reason why there is no picture, as a sentence; None if it was cancelled."""

    sentence: str | None
