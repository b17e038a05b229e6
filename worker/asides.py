"""The tasks that make something for a reader of the service: a denoised frame, motion vectors, an environment's thumbnail.

Each answers with one event, whatever happens: that it is made, or a sentence that says why not.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from worker import context
from worker.context import WorkerContext
from worker.contract import DenoiseFrame, FrameVectors, Result, ShowEnvironment
from worker.deaths import DEATHS_ALLOWED, deaths_of
from worker.denoise import denoise_failure, denoise_frame
from worker.environments import show_environment, show_failure
from worker.slot import InHand
from worker.vectors import frame_vectors, vectors_failure

__all__ = ["DENOISING", "ENVIRONMENTS", "MOTION_VECTORS"]

log = logging.getLogger(__name__)

Event = dict[str, Any]
Work = TypeVar("Work", DenoiseFrame, FrameVectors, ShowEnvironment)


@dataclass(frozen=True)
class _Aside(Generic[Work]):
    """One kind of them."""

    read: Callable[[Any], Work]  # from the message; raises ValueError
    make: Callable[[WorkerContext, Work], Event]
    failure: Callable[[WorkerContext, str, str], Event]  # of a work's id, with a sentence
    shown_as: str  # what the slot says it has in hand
    doing: str  # ... while the worker process did it

    def __call__(self, task: Any, message: dict[str, Any]) -> None:
        worker = context.current()
        worker.results.send(Result(self._event(task, worker, message)))

    def _event(self, task: Any, worker: WorkerContext, message: dict[str, Any]) -> Event:
        try:
            work = self.read(message)
        except ValueError as error:
            return self.failure(worker, str(message.get("work")), str(error))
        with InHand(worker, {self.shown_as: work.job, "frame": work.frame}):
            if deaths_of(task, worker, work.work) >= DEATHS_ALLOWED:
                sentence = f"the worker process died {DEATHS_ALLOWED} times while it {self.doing}"
                return self.failure(worker, work.work, sentence)
            try:
                return self.make(worker, work)
            except Exception as error:
                log.exception("%s: a fault", self.shown_as)
                sentence = f"{worker.name} could not make it ({type(error).__name__}: {error})"
                return self.failure(worker, work.work, sentence)


DENOISING = _Aside(DenoiseFrame.from_json, denoise_frame, denoise_failure, "denoise", "denoised this frame")
MOTION_VECTORS = _Aside(FrameVectors.from_json, frame_vectors, vectors_failure, "vectors", "made them")
ENVIRONMENTS = _Aside(ShowEnvironment.from_json, show_environment, show_failure, "environment", "read the image")
