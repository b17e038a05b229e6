"""/api/farm/kernels: machine code that one worker compiled, for the others of its kind. Workers show the farm's token."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse
from starlette.concurrency import run_in_threadpool

from renderer.artefact import MAX_BYTES
from service.errors import NotFound, TooLarge
from service.farm import FarmDependency
from service.store.room import full_disk

__all__ = ["router"]

router = APIRouter(prefix="/api/farm/kernels", tags=["farm"])


@router.get("/{name}", response_class=FileResponse)
def get_kernels(name: str, farm: FarmDependency) -> FileResponse:
    """The kernels of this name; renderer/artefact.py says what a name follows from and how the file is signed."""
    path = farm.kernels.find(name)
    if path is None:
        raise NotFound("The farm has no kernels of this name; compile them, and hand them in.")
    return FileResponse(path, media_type="application/octet-stream")


@router.put("/{name}", status_code=204)
async def put_kernels(name: str, request: Request, farm: FarmDependency) -> Response:
    """Hand in kernels, signed with the farm's token."""
    data = bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > MAX_BYTES:
            raise TooLarge(f"Kernels have at most {MAX_BYTES} bytes.")
    with full_disk():
        await run_in_threadpool(farm.kernels.put, name, bytes(data))
    return Response(status_code=204)
