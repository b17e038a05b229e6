"""Merges rendered batches into a job's film, all in one write."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass

from protocol.sums import check_sums, check_weight
from renderer.film import BadSample, plane_count
from renderer.settings import Tile
from service.scheduling.incoming.messages import BatchDone, BatchFailed, BatchReturned
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.plan import Range
from service.store.contributions import Contribution
from telemetry import tracing

__all__ = ["ReceivedBatch", "batch_of", "merge"]


@dataclass(frozen=True)
class ReceivedBatch:
    """A received batch. taken: whether the film accepted it; False for a duplicate or an unusable batch.

    fault: the reason why its sums cannot be used; None if they can.
    """

    message: BatchDone
    batch: Range | None  # None if the job does not need it, or no longer
    taken: bool
    fault: str | None = None  # why the sums are invalid


def merge(job: ActiveJob, answers: list[tuple[BatchDone, bytes]]) -> list[ReceivedBatch]:
    """Adds batches to a job's film if the job still needs them. Returns all batches.

    answers: messages with their packed sums. Raises FilmUnavailable or FilmLost; then no batch was added.
    """
    wanted = [_wanted_batch(message, job) for message, _ in answers]
    faults = [_weight_error(sums, batch, job) for (_, sums), batch in zip(answers, wanted, strict=True)]
    parts = [
        Contribution(
            batch.frame,
            batch.tile,
            batch.first,
            batch.count,
            sums,
            [BadSample(*sample) for sample in message.bad],
            message.bad_count,
            message.shares,
        )
        for (message, sums), batch, fault in zip(answers, wanted, faults, strict=True)
        if batch is not None and fault is None
    ]
    with tracing.span("film", tracing.root_span("job", job.id), batches=len(parts)) if parts else nullcontext():
        taken = iter(job.film.merge(parts) if parts else [])
    arrived = []
    for (message, sums), batch, fault in zip(answers, wanted, faults, strict=True):
        is_taken = batch is not None and fault is None and next(taken)
        if batch is not None and fault is None and not is_taken:
            fault = _decoding_error(sums, batch, job)
        arrived.append(ReceivedBatch(message, batch, is_taken, fault))
    return arrived


def batch_of(message: BatchDone | BatchFailed | BatchReturned, job: ActiveJob) -> Range | None:
    """Returns the batch that a message refers to; None if the job does not have the frame, or its film the tile."""
    tile = job.film.tile_index(Tile(*message.tile)) if message.frame in job.frames else None
    return None if tile is None else Range(tile, message.first, message.count, message.frame)


def _wanted_batch(message: BatchDone, job: ActiveJob) -> Range | None:
    batch = batch_of(message, job)
    return batch if batch is not None and job.needs_batch(batch) else None


def _weight_error(sums: bytes, batch: Range | None, job: ActiveJob) -> str | None:
    """Returns an error sentence if the sums have another number of samples than the batch, else None.

    batch: None if it is not needed any more; then the sums are not checked.
    """
    return None if batch is None else _error_of(lambda: _check_weight(sums, batch, job))


def _check_weight(sums: bytes, batch: Range, job: ActiveJob) -> None:
    planes = plane_count(len(job.film.groups), job.film.is_transparent)
    check_weight(sums, job.film.tiles[batch.tile], batch.count, planes, job.film.deep)


def _decoding_error(sums: bytes, batch: Range, job: ActiveJob) -> str | None:
    """Returns an error sentence if a batch's sums cannot be decoded, else None."""
    return _error_of(lambda: check_sums(sums, job.film.tiles[batch.tile]))


def _error_of(check: Callable[[], None]) -> str | None:
    try:
        check()
    except ValueError as error:
        return str(error)
    return None
