"""GET /api/info: the service's version, limits and accepted settings."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from renderer import __version__, aovs
from renderer.formats import ARCHIVE_SUFFIXES, FOREIGN, SCENE_SUFFIXES
from renderer.image.tonemap import CURVES
from renderer.sentences import codes_of
from renderer.setting_docs import described
from service.http.farm import FarmDependency
from service.http.routers import api_router

__all__ = ["router"]

router = api_router(tags=["info"])


@router.get("/api/info")
def info(farm: FarmDependency) -> dict[str, Any]:
    """Returns the version, the limits, and every setting of a request with its range, names and description."""
    settings = farm.settings
    return {
        "name": "rayfarm",
        "version": __version__,
        "limits": {
            "upload_bytes": settings.max_upload_bytes,
            "upload_files": settings.max_upload_files,
            "pixels": settings.max_pixels,
        },
        **described(),
        "curves": list(CURVES),
        "views": [asdict(view) for view in farm.curves.views],
        "aovs": list(aovs.NAMES),
        "channels": aovs.described(),
        "denoise": farm.engine.snapshot.roster.denoising_kind() is not None,
        "foreign": FOREIGN,
        "foreign_codes": codes_of(FOREIGN),
        "formats": [*SCENE_SUFFIXES, *ARCHIVE_SUFFIXES],
    }
