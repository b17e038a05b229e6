"""From the workers' answers to the film: the batches of a job become parts, all of them one write."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass

from renderer.film import BadSample
from renderer.settings import Tile
from service.scheduling.active_job import ActiveJob
from service.scheduling.messages import BatchDone, BatchFailed, BatchReturned
from service.scheduling.plan import Range
from service.store.parts import Part
from worker import tracing

__all__ = ["Arrived", "batch_of", "merge"]


@dataclass(frozen=True)
class Arrived:
    """A batch that came back. taken: whether the film took it, and does not have it already."""

    message: BatchDone
    batch: Range | None  # None where the job does not want it, or not any more
    taken: bool


def merge(job: ActiveJob, answers: list[tuple[BatchDone, bytes]]) -> list[Arrived]:
    """Add the batches that are wanted to the job's film. Raises FilmWaits or FilmLost; then none was added."""
    wanted = [_wanted(message, job) for message, _ in answers]
    parts = [
        Part(
            batch.frame,
            batch.tile,
            batch.first,
            batch.count,
            sums,
            [BadSample(*sample) for sample in message.bad],
            message.bad_count,
            message.senders,
        )
        for (message, sums), batch in zip(answers, wanted, strict=True)
        if batch is not None
    ]
    with tracing.span("film", tracing.root_of("job", job.id), batches=len(parts)) if parts else nullcontext():
        taken = iter(job.film.merge(parts) if parts else [])
    return [
        Arrived(message, batch, batch is not None and next(taken)) for (message, _), batch in zip(answers, wanted, strict=True)
    ]


def batch_of(message: BatchDone | BatchFailed | BatchReturned, job: ActiveJob) -> Range | None:
    """The batch that a message is about; None where the job has no such frame or its film no such tile."""
    tile = job.film.index_of(Tile(*message.tile)) if message.frame in job.frames else None
    return None if tile is None else Range(tile, message.first, message.count, message.frame)


def _wanted(message: BatchDone, job: ActiveJob) -> Range | None:
    batch = batch_of(message, job)
    return batch if batch is not None and job.wants(batch) else None
