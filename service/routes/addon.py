"""GET /api/blender-addon.zip: the add-on that lets Blender render on this farm."""

from __future__ import annotations

from fastapi import Response

from service.addon import FILE, addon_zip
from service.http.file_names import named
from service.http.routers import api_router

__all__ = ["router"]

router = api_router(tags=["farm"])
ZIP = {"content": {"application/zip": {}}, "description": "The add-on."}


@router.get("/api/blender-addon.zip", response_class=Response, responses={200: ZIP})
def blender_addon() -> Response:
    """The add-on for Blender 4.2 and later, as Blender installs it. It is the same for everybody, and knows no token."""
    return Response(addon_zip(), media_type="application/zip", headers={"Content-Disposition": named(FILE, "attachment")})
