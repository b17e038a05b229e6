"""Groups batches into messages.

Either several short batches of a shot are sent to one slot, since at a few samples per frame a batch takes less time than its
message. Or consecutive batches of one tile are sent to several slots of one machine, which adds up their sums (a joint
message).
"""

from __future__ import annotations

from dataclasses import dataclass

from protocol.contract import RenderBatch
from protocol.joint import JointBatch, Piece, Run
from protocol.sums import PACKED
from service.scheduling.dispatching.leases import Lease
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.plan import Range

__all__ = ["BatchGroup", "SlotGroup", "batch_message", "joint_message", "next_batch_groups"]

MAX_BATCHES = 32


@dataclass(frozen=True)
class SlotGroup:
    """The slots of one worker kind to which batches are sent.

    batch_s: target duration of a batch in seconds. message_s: that of a message with several batches of a shot.
    whole_s: longest duration of a batch with all samples of a tile of a shot.
    """

    kind: str
    slots: int
    batch_s: float
    several: bool  # whether all workers accept several batches in one message
    joint: bool  # whether all workers add up the sums of one tile
    max_run: int = 1  # maximum number of consecutive batches of one tile
    most: int = 2  # maximum number of slots to occupy at once
    message_s: float = 0.0
    whole_s: float = 0.0


@dataclass(frozen=True)
class BatchGroup:
    """The batches of one message.

    is_joint: whether they are consecutive batches of one tile, whose sums the receiving machine adds up.
    run: for a message to a site, the samples that the machines of the site render together.
    queue: the queue of a site or of a worker with graphics cards; "" for the queue of the worker kind.
    only: name of the worker with graphics cards that is the only receiver; "" for any worker.
    is_of_card: whether a graphics card renders the batches.
    """

    batches: list[Range]
    is_joint: bool = False
    run: Run | None = None
    queue: str = ""
    only: str = ""
    is_of_card: bool = False


def next_batch_groups(job: ActiveJob, slots: SlotGroup) -> list[BatchGroup]:
    """Returns the messages with a job's next batches; an empty list if it has none.

    A batch of unknown duration, or one that failed before, is sent alone, so that it cannot affect others.
    """
    first = job.next_batch(slots.batch_s, slots.slots, slots.kind, slots.max_run, slots.whole_s)
    if first is None:
        return []
    if not _has_known_cost(job, first):
        return [BatchGroup([first])]
    if slots.several and job.shot is not None and job.expected_s(first) < job.target_s(slots.message_s, slots.slots):
        return _batches_of_many_tiles(job, slots, first)
    return _batches_of_one_tile(job, slots, first) if slots.joint and slots.max_run > 1 else [BatchGroup([first])]


def batch_message(job: ActiveJob, lease: Lease, batch: Range) -> RenderBatch:
    """Returns the message that asks a worker to render one batch."""
    frame, tile = job.frames[batch.frame], job.film.tiles[batch.tile]
    settings = frame.settings or job.settings
    compiled, guide = frame.compiled[lease.kind], frame.guides.get(lease.kind, "")
    return RenderBatch(lease.id, job.id, frame.key, compiled, tile, batch.first, batch.count, settings, PACKED, guide)


def joint_message(job: ActiveJob, leases: list[Lease], batches: list[Range], hold_s: float, run: Run | None = None) -> JointBatch:
    """Returns the joint message for consecutive batches of a tile. leases: the lease of each batch.

    hold_s: how long, in seconds, the sums of one batch may wait for those of the others. run: for a site, the samples that its
    machines render together; else None.
    """
    whole = batches[0]._replace(count=sum(batch.count for batch in batches))
    pieces = tuple(Piece(lease.id, batch.first, batch.count) for lease, batch in zip(leases, batches, strict=True))
    return JointBatch(batch_message(job, leases[0], whole), pieces, hold_s, leases[0].queue, run)


def _batches_of_many_tiles(job: ActiveJob, slots: SlotGroup, first: Range) -> list[BatchGroup]:
    batches = [first]
    aim = job.target_s(slots.message_s, slots.slots)
    expected = job.expected_s(first)
    while (
        expected < aim
        and len(batches) < MAX_BATCHES
        and not job.agenda.is_out_of_order(job.frames[batches[-1].frame], slots.kind)
    ):
        batch = job.next_batch(slots.batch_s, slots.slots, slots.kind, whole_seconds=slots.whole_s)
        if batch is None:
            break
        if not _has_known_cost(job, batch):
            return [BatchGroup(batches), *_separate_group(job, slots, 1, batch)]
        expected += job.expected_s(batch)
        batches.append(batch)
    return [BatchGroup(batches)]


def _batches_of_one_tile(job: ActiveJob, slots: SlotGroup, first: Range) -> list[BatchGroup]:
    batches = [first]
    while len(batches) < min(slots.max_run, slots.most):
        last = batches[-1]
        batch = job.next_batch(slots.batch_s, slots.slots, slots.kind, slots.max_run)
        if batch is None:
            break
        if batch[:2] != (last.tile, last.first + last.count) or batch.frame != last.frame or not _has_known_cost(job, batch):
            return [BatchGroup(batches, is_joint=len(batches) > 1), *_separate_group(job, slots, len(batches), batch)]
        batches.append(batch)
    return [BatchGroup(batches, is_joint=len(batches) > 1)]


def _separate_group(job: ActiveJob, slots: SlotGroup, occupied: int, batch: Range) -> list[BatchGroup]:
    """Returns a list with one message, for a batch that cannot be grouped with the previous ones.

    occupied: number of slots for which batches were found before. If no slot is left, puts the batch back into the job's plan
    and returns an empty list.
    """
    if occupied < slots.most:
        return [BatchGroup([batch])]
    job.requeue(batch)
    return []


def _has_known_cost(job: ActiveJob, batch: Range) -> bool:
    return batch not in job.trouble and job.expected_s(batch) > 0.0
