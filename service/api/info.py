"""GET /api/info: what this service is and what it takes."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from renderer import __version__
from renderer.aovs import AOVS
from renderer.formats import ARCHIVE_SUFFIXES, SCENE_SUFFIXES
from renderer.image.tonemap import CURVES
from renderer.settings import (
    FILTERS,
    HEURISTICS,
    INTEGRATORS,
    LIGHT_CHOICES,
    MAX_DEPTH,
    MAX_LIGHT_SAMPLES,
    MAX_SIZE,
    MAX_SPP,
    PROJECTIONS,
    SAMPLERS,
    SAMPLINGS,
)
from service.farm import FarmDependency

__all__ = ["router"]

router = APIRouter(tags=["info"])


@router.get("/api/info")
def info(farm: FarmDependency) -> dict[str, Any]:
    """The version, the limits, and the names that requests may use."""
    settings = farm.settings
    return {
        "name": "rayfarm",
        "version": __version__,
        "limits": {
            "upload_bytes": settings.max_upload_bytes,
            "upload_files": settings.max_upload_files,
            "pixels": settings.max_pixels,
            "size": MAX_SIZE,
            "spp": MAX_SPP,
            "max_depth": MAX_DEPTH,
            "light_samples": MAX_LIGHT_SAMPLES,
        },
        "integrators": list(INTEGRATORS),
        "samplings": list(SAMPLINGS),
        "heuristics": list(HEURISTICS),
        "light_choices": list(LIGHT_CHOICES),
        "samplers": list(SAMPLERS),
        "filters": list(FILTERS),
        "projections": list(PROJECTIONS),
        "curves": list(CURVES),
        "aovs": list(AOVS),
        "denoise": farm.engine.snapshot.roster.denoising_kind() is not None,
        "formats": [*SCENE_SUFFIXES, *ARCHIVE_SUFFIXES],
    }
