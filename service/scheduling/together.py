"""Batches that go to a worker in one message: at a few samples a frame of a shot takes less time than its message."""

from __future__ import annotations

from service.scheduling.active_job import ActiveJob
from service.scheduling.plan import Range
from worker.contract import RenderBatch
from worker.sums import PACKED

__all__ = ["together", "work_of"]

SHARE = 0.5  # of what a batch may take: a slot has two messages, and what waits in them cannot be taken by another
MOST = 32


def together(
    job: ActiveJob, batch_seconds: float, slots: int, kind: str, several: bool, of_a_tile: int = 1, most: int = 2
) -> list[list[Range]]:
    """What a job hands out next, by messages; none where it has nothing. several: whether the workers take such.
    of_a_tile: how many of one tile may follow each other. most: messages.

    A batch of which nobody knows how long it takes goes alone, and so does one that had trouble: others must not suffer for it.
    """
    first = job.next(batch_seconds, slots, kind, of_a_tile)
    if first is None:
        return []
    groups = [[first]]
    if not several or job.shot is None or not _is_known(job, first):
        return groups
    aim = SHARE * job.aim_s(batch_seconds, slots)
    expected = job.expected_s(first)
    while expected < aim and len(groups[0]) < MOST and not job.agenda.overtakes(job.frames[groups[0][-1].frame], kind):
        batch = job.next(batch_seconds, slots, kind)
        if batch is None:
            break
        if not _is_known(job, batch):
            if most > 1:
                groups.append([batch])
            else:
                job.lose(batch)
            break
        expected += job.expected_s(batch)
        groups[0].append(batch)
    return groups


def work_of(job: ActiveJob, kind: str, lease: str, batch: Range) -> RenderBatch:
    """A batch as workers of a kind are told of it."""
    frame, tile = job.frames[batch.frame], job.film.tiles[batch.tile]
    settings = frame.settings or job.settings
    return RenderBatch(lease, job.id, frame.key, frame.compiled[kind], tile, batch.first, batch.count, settings, PACKED)


def _is_known(job: ActiveJob, batch: Range) -> bool:
    return batch not in job.trouble and job.expected_s(batch) > 0.0
