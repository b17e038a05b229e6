"""GET /api/view-table: an OpenColorIO view as a 3D table, for shaders."""

from __future__ import annotations

import functools
import gzip
import hashlib
from typing import Annotated

from fastapi import Query, Request, Response

from protocol.view_table import encode_view_table
from renderer.image.ocio import ViewTransform
from service.http.farm import FarmDependency
from service.http.routers import api_router

__all__ = ["router"]

router = api_router(tags=["info"])

TABLE = {
    "content": {"application/octet-stream": {}},
    "description": "The table: a packet for the page, whose layout may change with each release.",
}


@router.get("/api/view-table", response_class=Response, responses={200: TABLE, 304: {"description": "Not changed."}})
def view_table(
    request: Request,
    farm: FarmDependency,
    name: Annotated[str, Query(alias="tonemap", max_length=400, description="a view of GET /api/info, as ocio:DISPLAY/VIEW")],
) -> Response:
    """Returns a view as a table of display values, by which a viewer shows pictures while exposure changes."""
    view = farm.curves.find_view(name)
    is_packed = "gzip" in request.headers.get("accept-encoding", "")
    key = hashlib.sha256(f"{view.key} {is_packed}".encode()).hexdigest()[:32]
    headers = {"ETag": f'"{key}"', "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    if is_packed:
        headers["Content-Encoding"] = "gzip"
    return Response(_table(view, is_packed), headers=headers, media_type="application/octet-stream")


@functools.lru_cache(maxsize=8)  # about 1 MB each; making one takes 0.3 s
def _table(view: ViewTransform, is_packed: bool) -> bytes:
    table = encode_view_table(view.lut())
    return gzip.compress(table, 1, mtime=0) if is_packed else table
