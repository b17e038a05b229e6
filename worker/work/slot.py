"""Reports what a slot does at present."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Self

from protocol.contract import RenderBatch
from telemetry import tracing
from telemetry.log_lines import ids
from worker.process.context import WorkerContext
from worker.process.slot_number import slot
from worker.telemetry.batch_warnings import collect_warnings
from worker.telemetry.task_context import message_ids
from worker.work.render import BatchOutcome, render

__all__ = ["SlotTask", "rendering_batch"]

log = logging.getLogger(__name__)


class SlotTask:
    """Context manager during which the slot is reported as busy with a task. doing: fields that describe the task.

    speed: samples per second, set by the caller if it rendered.
    """

    def __init__(self, worker: WorkerContext, doing: dict[str, Any]) -> None:
        self._worker = worker
        self._doing = doing
        self.speed = 0.0

    def __enter__(self) -> Self:
        self._worker.board.write(slot(), self._doing)
        return self

    def __exit__(self, *_: object) -> None:
        self._worker.board.write(slot(), {}, self.speed)

    def report_part(self, doing: dict[str, Any]) -> None:
        """Reports the next part of the task. doing: fields that describe it."""
        self._doing = doing
        self._worker.board.write(slot(), doing)

    def report_compiling(self, is_compiling: bool) -> None:
        """Reports whether this slot is compiling a kernel for the task."""
        self._worker.board.write(slot(), self._doing | {"compiling": is_compiling})


@contextmanager
def rendering_batch(worker: WorkerContext, work: RenderBatch, message: str) -> Iterator[Callable[..., BatchOutcome]]:
    """Context manager in which the slot is reported as rendering a batch; yields the function that renders it.

    Its argument, if given, is called before the kernel runs. message: id of the Celery message.
    """
    about = {key: getattr(work, key) for key in ("batch", "job", "frame", "first", "count")}
    with SlotTask(worker, {**about, "tile": list(work.tile), "message": message}) as hand:

        def render_batch(begins: Callable[[], None] = lambda: None) -> BatchOutcome:
            # A piece shared by another slot comes without a trace context from the service.
            parent = tracing.current_span() or tracing.root_span("job", work.job)
            with collect_warnings() as logged, tracing.span("batch", parent, **message_ids(vars(work))):
                outcome = render(worker, work, hand.report_compiling, begins)
                if tracing.is_on():
                    outcome.event["traceparents"] = [str(tracing.current_span())]
            outcome.event.update(logged.result_fields())
            if outcome.sums is not None:
                hand.speed = work.tile.w * work.tile.h * work.count / max(outcome.event.get("seconds", 0.0), 1e-6)
            if log.isEnabledFor(logging.DEBUG):
                about_it = ids(**{name: outcome.event.get(name) for name in ("first", "count", "seconds", "error")})
                log.debug("%s", outcome.event["type"], extra=about_it)
            return outcome

        yield render_batch
