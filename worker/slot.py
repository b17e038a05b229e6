"""A slot at work on a batch, as the worker reports it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from billiard import current_process

from worker.context import WorkerContext
from worker.contract import RenderBatch, Result
from worker.log_lines import ids
from worker.render import render

__all__ = ["at_work", "slot"]

log = logging.getLogger(__name__)


def slot() -> int:
    """This process's slot: its place in the prefork pool, taken over by whoever replaces it."""
    return int(getattr(current_process(), "index", 0) or 0)


@contextmanager
def at_work(worker: WorkerContext, work: RenderBatch, message: str) -> Iterator[Callable[[], Result]]:
    """While it lasts, the slot says that it has this batch in hand; what is yielded renders it."""
    about = {key: getattr(work, key) for key in ("batch", "job", "frame", "first", "count")}
    doing = {**about, "tile": list(work.tile), "message": message}
    speed = 0.0

    def do() -> Result:
        nonlocal speed
        result = render(worker, work, lambda is_so: worker.board.write(slot(), doing | {"compiling": is_so}))
        if result.sums is not None:
            speed = work.tile.w * work.tile.h * work.count / max(result.event.get("seconds", 0.0), 1e-6)
        if log.isEnabledFor(logging.DEBUG):
            about_it = ids(**{name: result.event.get(name) for name in ("first", "count", "seconds", "error")})
            log.debug("%s", result.event["type"], extra=about_it)
        return result

    worker.board.write(slot(), doing)
    try:
        yield do
    finally:
        worker.board.write(slot(), {}, speed)
