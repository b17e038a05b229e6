"""Tasks for artifacts: denoised frames, motion vectors and thumbnails of environments, which clients request, and path guides.

Each sends exactly one event: success, or failure with a sentence.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from protocol.contract import DenoiseFrame, FrameVectors, Result, ShowEnvironment, TrainPathGuide
from renderer.errors import RayfarmError
from renderer.sentences import Sentence
from worker.exchange.errors import MachineError, UnfitError, WorkerError, WorkError, is_of_machine
from worker.process import context
from worker.process.context import WorkerContext
from worker.work.deaths import DEATHS_ALLOWED, count_deaths
from worker.work.denoise import denoise_frame
from worker.work.environments import show_environment
from worker.work.path_guides import train_frame_guide
from worker.work.slot import SlotTask
from worker.work.vectors import make_frame_vectors

__all__ = ["DENOISING", "ENVIRONMENTS", "MOTION_VECTORS", "PATH_GUIDES", "ArtifactTask"]

log = logging.getLogger(__name__)

Work = TypeVar("Work", DenoiseFrame, FrameVectors, ShowEnvironment, TrainPathGuide)


@dataclass(frozen=True)
class ArtifactTask(Generic[Work]):
    """A Celery task that makes one type of artifact.

    read: parses the message; raises ValueError. make: does the work and returns fields for the event; may raise any error.
    made, failed: types of the event on success and on failure. shown_as: key under which the worker's report shows the job.
    task: the action as a phrase for error messages, such as "denoise the picture".
    """

    read: Callable[[Any], Work]
    make: Callable[[WorkerContext, Work], dict[str, Any]]
    made: str
    failed: str
    shown_as: str
    task: str

    def __call__(self, task: Any, message: dict[str, Any]) -> None:
        """Runs the Celery task: makes the artifact and sends the event."""
        worker = context.current()
        worker.results.send(Result(self.event(task, worker, message)))

    def event(self, task: Any, worker: WorkerContext, message: dict[str, Any]) -> dict[str, Any]:
        """Makes the artifact that a message requests; returns the event of success or failure."""
        try:
            work = self.read(message)
        except (ValueError, RayfarmError) as error:
            return self._failure(worker, message.get("work"), str(error))
        with SlotTask(worker, {self.shown_as: work.job, "frame": work.frame}):
            if count_deaths(task, worker, work.work) >= DEATHS_ALLOWED:
                died = Sentence(
                    "worker-died-during-task",
                    "the worker process died {count} times while it tried to {task}",
                    count=DEATHS_ALLOWED,
                    task=self.task,
                )
                return self._failure(worker, work.work, died)
            sentence: str
            try:
                return {"type": self.made, "work": work.work, "worker": worker.name, **self.make(worker, work)}
            except WorkError as error:
                sentence = str(error)
            except (UnfitError, MachineError) as error:
                return self._failure(worker, work.work, str(error), unfit=True)
            except WorkerError as error:
                sentence = Sentence(
                    "worker-task-failed", "{worker} could not {task}: {error}", worker=worker.name, task=self.task, error=error
                )
            except OSError as error:
                if is_of_machine(error):
                    return self._failure(
                        worker,
                        work.work,
                        Sentence("machine-task-failed", "this machine could not {task}: {error}", task=self.task, error=error),
                        unfit=True,
                    )
                sentence = Sentence(
                    "worker-task-without-room",
                    "{worker} has no room to {task}: {error}",
                    worker=worker.name,
                    task=self.task,
                    error=error,
                )
            except MemoryError:
                return self._failure(
                    worker,
                    work.work,
                    Sentence("task-memory-exhausted", "there is too little memory to {task}", task=self.task),
                    unfit=True,
                )
            except Exception as error:
                log.exception("could not %s", self.task)
                sentence = Sentence(
                    "worker-task-error",
                    "{worker} could not {task} ({kind}: {error})",
                    worker=worker.name,
                    task=self.task,
                    kind=type(error).__name__,
                    error=error,
                )
            return self._failure(worker, work.work, sentence)

    def _failure(self, worker: WorkerContext, work: Any, error: str, unfit: bool = False) -> dict[str, Any]:
        """Returns the event of a failure. work: id of the request. unfit: whether another worker may succeed."""
        event = {"type": self.failed, "work": work, "worker": worker.name, "error": error}
        return {**event, "unfit": True} if unfit else event


DENOISING = ArtifactTask(
    DenoiseFrame.from_json,
    denoise_frame,
    "denoised",
    "denoise-failed",
    "denoise",
    Sentence("task-denoise-picture", "denoise the picture"),
)
MOTION_VECTORS = ArtifactTask(
    FrameVectors.from_json,
    make_frame_vectors,
    "vectors-made",
    "vectors-failed",
    "vectors",
    Sentence("task-make-vectors", "make motion vectors"),
)
PATH_GUIDES = ArtifactTask(
    TrainPathGuide.from_json,
    train_frame_guide,
    "path-guide-trained",
    "path-guide-failed",
    "path_guide",
    Sentence("task-train-guide", "train the path guide"),
)
ENVIRONMENTS = ArtifactTask(
    ShowEnvironment.from_json,
    show_environment,
    "environment-shown",
    "environment-failed",
    "environment",
    Sentence("task-read-image", "read the image"),
)
