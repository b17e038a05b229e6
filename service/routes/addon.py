"""GET /api/blender-addon.zip: Blender's add-on, which renders on this farm."""

from __future__ import annotations

from fastapi import Response

from service.addon import FILE, addon_zip
from service.http.file_names import content_disposition
from service.http.routers import api_router

__all__ = ["router"]

router = api_router(tags=["farm"])
ZIP = {"content": {"application/zip": {}}, "description": "The add-on."}


@router.get("/api/blender-addon.zip", response_class=Response, responses={200: ZIP})
def blender_addon() -> Response:
    """Returns the add-on for Blender 4.2 and later as an installable zip. It is the same for all users and contains no token."""
    return Response(
        addon_zip(), media_type="application/zip", headers={"Content-Disposition": content_disposition(FILE, "attachment")}
    )
