"""From the workers' answers to the film: the batches of a job become parts, all of them one write."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass

from protocol.sums import check_sums, check_weight
from renderer.film import BadSample
from renderer.settings import Tile
from service.scheduling.incoming.messages import BatchDone, BatchFailed, BatchReturned
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.plan import Range
from service.store.contributions import Part
from telemetry import tracing

__all__ = ["Arrived", "batch_of", "merge"]


@dataclass(frozen=True)
class Arrived:
    """A batch that came back. taken: whether the film took it, and does not have it already."""

    message: BatchDone
    batch: Range | None  # None where the job does not want it, or not any more
    taken: bool
    fault: str | None = None  # why its sums are none


def merge(job: ActiveJob, answers: list[tuple[BatchDone, bytes]]) -> list[Arrived]:
    """Add the batches that are wanted to the job's film. Raises FilmWaits or FilmLost; then none was added."""
    wanted = [_wanted(message, job) for message, _ in answers]
    faults = [_weight(sums, batch, job) for (_, sums), batch in zip(answers, wanted, strict=True)]
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
        for (message, sums), batch, fault in zip(answers, wanted, faults, strict=True)
        if batch is not None and fault is None
    ]
    with tracing.span("film", tracing.root_of("job", job.id), batches=len(parts)) if parts else nullcontext():
        taken = iter(job.film.merge(parts) if parts else [])
    arrived = []
    for (message, sums), batch, fault in zip(answers, wanted, faults, strict=True):
        is_taken = batch is not None and fault is None and next(taken)
        if batch is not None and fault is None and not is_taken:
            fault = _damage(sums, batch, job)
        arrived.append(Arrived(message, batch, is_taken, fault))
    return arrived


def batch_of(message: BatchDone | BatchFailed | BatchReturned, job: ActiveJob) -> Range | None:
    """The batch that a message is about; None where the job has no such frame or its film no such tile."""
    tile = job.film.index_of(Tile(*message.tile)) if message.frame in job.frames else None
    return None if tile is None else Range(tile, message.first, message.count, message.frame)


def _wanted(message: BatchDone, job: ActiveJob) -> Range | None:
    batch = batch_of(message, job)
    return batch if batch is not None and job.wants(batch) else None


def _weight(sums: bytes, batch: Range | None, job: ActiveJob) -> str | None:
    """Why a batch's sums would give its samples another weight than theirs; None where they do not, or are not wanted."""
    return None if batch is None else _fault(lambda: check_weight(sums, job.film.tiles[batch.tile], batch.count))


def _damage(sums: bytes, batch: Range, job: ActiveJob) -> str | None:
    """Why a batch's sums cannot be read; None where they can."""
    return _fault(lambda: check_sums(sums, job.film.tiles[batch.tile]))


def _fault(check: Callable[[], None]) -> str | None:
    try:
        check()
    except ValueError as error:
        return str(error)
    return None
