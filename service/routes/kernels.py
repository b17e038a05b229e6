"""/api/farm/kernels: machine code that one worker compiled, for other workers of the same kind.

Loading a kernel executes its code. So uploads are accepted only with the farm's own token. A worker that authenticates with a
worker token may only download kernels, which are then signed with that token.
"""

from __future__ import annotations

from fastapi import Request, Response
from fastapi.responses import FileResponse
from starlette.concurrency import run_in_threadpool

from renderer.kernel_file import MAX_BYTES
from renderer.sentences import Sentence
from service.access.visit import Visit
from service.errors import NotFound, TooLarge
from service.http.farm import FarmDependency
from service.http.problems import Problem
from service.http.routers import api_router
from service.http.visit import VisitDependency, bearer_token
from service.store.disk_space import translated_disk_errors

__all__ = ["router"]

router = api_router(prefix="/api/farm/kernels", tags=["farm"])

TOKEN_NOT_ACCEPTED = Sentence(
    "kernels-token-not-accepted",
    "Kernels are accepted only from workers that show the farm's own token, since all workers run them. "
    "This worker has a token of its own; it keeps what it compiled for itself.",
)


@router.get("/{name}", response_class=FileResponse)
def get_kernels(name: str, farm: FarmDependency, visit: VisitDependency, request: Request) -> Response:
    """Returns the kernels with this name, which tells release, processor and variant."""
    path = farm.kernels.find(name)
    if path is None:
        raise NotFound(Sentence("kernels-not-found", "The farm has no kernels of this name; compile and upload them."))
    if not _has_own_token(visit):
        return FileResponse(path, media_type="application/octet-stream")
    data = farm.kernels.signed_for(name, bearer_token(request.headers))
    return Response(data, media_type="application/octet-stream")


@router.put("/{name}", status_code=204)
async def put_kernels(name: str, request: Request, farm: FarmDependency, visit: VisitDependency) -> Response:
    """Stores kernels that are signed with the farm's token."""
    if _has_own_token(visit):
        raise Problem(403, TOKEN_NOT_ACCEPTED)
    data = bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > MAX_BYTES:
            raise TooLarge(Sentence("kernels-too-large", "Kernels may have at most {most} bytes.", most=MAX_BYTES))
    with translated_disk_errors():
        await run_in_threadpool(farm.kernels.put, name, bytes(data))
    return Response(status_code=204)


def _has_own_token(visit: Visit) -> bool:
    return visit.caller is not None and visit.caller.key is not None
