"""What is asked of a farm for one picture, and what it tells while it makes it. Nothing here knows of Blender."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .packets import Words

__all__ = ["Asked", "Done", "Failed", "Grown", "Light", "Said"]


@dataclass(frozen=True)
class Light:
    """The light from all around: a radiance, a picture (name and content), or what the scene file has."""

    color: list[float] | None = None
    image: tuple[str, bytes | Path] | None = None
    is_own: bool = False  # the scene file's
    strength: float = 1.0
    rotation: float = 0.0


@dataclass(frozen=True)
class Asked:
    """A picture. files: of its scene, by name. request: as POST /api/jobs takes it, without scene and light. planes: AOVs."""

    files: dict[str, bytes | Path]
    main: str
    title: str
    light: Light
    request: dict[str, Any]
    planes: tuple[str, ...] = ()
    denoise: bool = False


@dataclass(frozen=True)
class Said:
    """How it goes. progress: 0 to 1; None: not known."""

    text: str
    progress: float | None = None


@dataclass(frozen=True)
class Grown:
    """A tile with more samples, from the upper left corner of the picture. words: (h, w) RGB9E5."""

    x: int
    y: int
    words: Words


@dataclass(frozen=True)
class Done:
    """The whole picture: channels by their EXR names, each (h, w) float32, rows from the top."""

    channels: dict[str, npt.NDArray[np.float32]]
    job: str
    sent_bytes: int
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Failed:
    """Why there is no picture, as a sentence; None: it was cancelled."""

    sentence: str | None
