"""The request for one image, and the events emitted while it is rendered. Independent of Blender."""

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
    """The environment light: a constant radiance, an image (name and content), or that of the scene file (`is_own`)."""

    color: list[float] | None = None
    image: tuple[str, bytes | Path] | None = None
    is_own: bool = False  # use the scene file's light
    strength: float = 1.0
    rotation: float = 0.0


@dataclass(frozen=True)
class RenderRequest:
    """The request for one image.

    files: the scene's files by name; main: the name of the scene file. request: the fields of POST /api/jobs except scene and
    light. planes: the AOVs.
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
    """Event: a status message for the user. progress: 0 to 1; None if unknown."""

    text: str
    progress: float | None = None


@dataclass(frozen=True)
class TileUpdate:
    """Event: a tile with more samples. x, y: pixels from the image's upper left corner. words: (h, w) RGB9E5."""

    x: int
    y: int
    words: Words


@dataclass(frozen=True)
class FinishedPicture:
    """Event: the rendering has finished. The image has a (h, w) float32 plane for each EXR channel name, rows from the top."""

    channels: dict[str, npt.NDArray[np.float32]]
    job: str
    sent_bytes: int
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Failed:
    """Event: the rendering ended without an image. Contains the reason as a sentence, or None if the job was cancelled."""

    sentence: str | None
