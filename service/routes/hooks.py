"""/api/hooks: notifications about jobs, and the state of their delivery."""

from __future__ import annotations

import time
import uuid
from typing import Any

from fastapi import Response
from sqlalchemy import func, select

from renderer.sentences import Sentence
from service.errors import NotFound, Unavailable
from service.farm import Farm
from service.hooks.deliver import UndeliveredError, redacted_hook
from service.hooks.message import test_message
from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.store.models import Delivery

__all__ = ["router"]

router = api_router(prefix="/api/hooks", tags=["hooks"])


@router.get("")
def list_hooks(farm: FarmDependency) -> list[dict[str, Any]]:
    """Lists all hooks with their numbers of delivered, pending and abandoned messages, and the latest error."""
    return [_hook_status(farm, number, hook) for number, hook in enumerate(farm.outbox.hooks)]


@router.post("/{number}/test", status_code=204)
def test_hook(number: int, farm: FarmDependency) -> Response:
    """Sends a test message to the hook with this number. 503 with the reason if the delivery fails."""
    if not 0 <= number < len(farm.outbox.hooks):
        raise NotFound(
            Sentence("hook-not-found", "There is no such hook. Hooks are set by RAYFARM_WEBHOOKS and RAYFARM_JOB_HOOK.")
        )
    try:
        farm.outbox.send_now(farm.outbox.hooks[number], f"msg_{uuid.uuid4().hex}", test_message(time.time()))
    except UndeliveredError as error:
        raise Unavailable(Sentence("hook-message-failed", "The message was not delivered. {error}", error=error)) from None
    return Response(status_code=204)


def _hook_status(farm: Farm, number: int, hook: str) -> dict[str, Any]:
    messages = select(func.count()).where(Delivery.hook == hook, Delivery.job != "")
    with farm.sessions() as session:
        arrived = session.scalar(messages.where(Delivery.done.is_not(None)))
        waiting = session.scalar(messages.where(Delivery.due.is_not(None)))
        given_up = session.scalar(messages.where(Delivery.due.is_(None), Delivery.done.is_(None)))
        failed = select(Delivery.error).where(Delivery.hook == hook, Delivery.error.is_not(None))
        error = session.scalar(failed.order_by(Delivery.ended.desc()).limit(1))
    return {
        "number": number,
        "hook": redacted_hook(hook),
        "arrived": arrived,
        "waiting": waiting,
        "given_up": given_up,
        "error": error,
    }
