"""Batches that travel in one message: short ones that one slot renders in turn, because at a few samples a frame a batch of a
shot takes less time than its message; and batches of a tile that the slots of one machine render together and add up."""

from __future__ import annotations

from dataclasses import dataclass

from protocol.contract import RenderBatch
from protocol.joint import JointBatch, Piece, Run
from protocol.sums import PACKED
from service.scheduling.dispatching.leases import Lease
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.plan import Range

__all__ = ["Handful", "Hands", "joint_work_of", "together", "work_of"]

SHARE = 0.5  # of what a batch may take: a slot has two messages, and what waits in them cannot be taken by another
MOST = 32


@dataclass(frozen=True)
class Hands:
    """Who renders: so many slots of workers of a kind. batch_s: what a batch is to take."""

    kind: str
    slots: int
    batch_s: float
    several: bool  # whether all of them take batches to be rendered in turn
    joint: bool  # whether all of them take a tile's to be added up
    of_a_tile: int = 1  # how many of one tile may follow each other
    most: int = 2  # slots that what is handed out at a time may take


@dataclass(frozen=True)
class Handful:
    """What goes in one message. is_joint: batches of a tile that follow each other, for slots that add them up.

    run, queue: where it goes to a site, of what it is a part, and in which queue."""

    batches: list[Range]
    is_joint: bool = False
    run: Run | None = None
    queue: str = ""


def together(job: ActiveJob, hands: Hands) -> list[Handful]:
    """What a job hands out next, by messages; none where it has nothing.

    A batch of which nobody knows how long it takes goes alone, and so does one that had trouble: others must not suffer for it.
    """
    first = job.next(hands.batch_s, hands.slots, hands.kind, hands.of_a_tile)
    if first is None:
        return []
    if not _is_known(job, first):
        return [Handful([first])]
    if hands.several and job.shot is not None and job.expected_s(first) < SHARE * job.aim_s(hands.batch_s, hands.slots):
        return _in_turn(job, hands, first)
    return _of_a_tile(job, hands, first) if hands.joint and hands.of_a_tile > 1 else [Handful([first])]


def work_of(job: ActiveJob, lease: Lease, batch: Range) -> RenderBatch:
    """A batch as workers are told of it."""
    frame, tile = job.frames[batch.frame], job.film.tiles[batch.tile]
    settings = frame.settings or job.settings
    compiled = frame.compiled[lease.kind]
    return RenderBatch(lease.id, job.id, frame.key, compiled, tile, batch.first, batch.count, settings, PACKED)


def joint_work_of(job: ActiveJob, leases: list[Lease], batches: list[Range], hold_s: float, run: Run | None = None) -> JointBatch:
    """Batches of a tile as workers are told of them. hold_s: how long one's sums may wait for the others'."""
    whole = batches[0]._replace(count=sum(batch.count for batch in batches))
    pieces = tuple(Piece(lease.id, batch.first, batch.count) for lease, batch in zip(leases, batches, strict=True))
    return JointBatch(work_of(job, leases[0], whole), pieces, hold_s, leases[0].queue, run)


def _in_turn(job: ActiveJob, hands: Hands, first: Range) -> list[Handful]:
    batches = [first]
    aim = SHARE * job.aim_s(hands.batch_s, hands.slots)
    expected = job.expected_s(first)
    while expected < aim and len(batches) < MOST and not job.agenda.overtakes(job.frames[batches[-1].frame], hands.kind):
        batch = job.next(hands.batch_s, hands.slots, hands.kind)
        if batch is None:
            break
        if not _is_known(job, batch):
            return [Handful(batches), *_alone(job, hands, 1, batch)]
        expected += job.expected_s(batch)
        batches.append(batch)
    return [Handful(batches)]


def _of_a_tile(job: ActiveJob, hands: Hands, first: Range) -> list[Handful]:
    batches = [first]
    while len(batches) < min(hands.of_a_tile, hands.most):
        last = batches[-1]
        batch = job.next(hands.batch_s, hands.slots, hands.kind, hands.of_a_tile)
        if batch is None:
            break
        if batch[:2] != (last.tile, last.first + last.count) or batch.frame != last.frame or not _is_known(job, batch):
            return [Handful(batches, is_joint=len(batches) > 1), *_alone(job, hands, len(batches), batch)]
        batches.append(batch)
    return [Handful(batches, is_joint=len(batches) > 1)]


def _alone(job: ActiveJob, hands: Hands, taken: int, batch: Range) -> list[Handful]:
    """A batch that does not go with those before it, where it may go at all now."""
    if taken < hands.most:
        return [Handful([batch])]
    job.lose(batch)
    return []


def _is_known(job: ActiveJob, batch: Range) -> bool:
    return batch not in job.trouble and job.expected_s(batch) > 0.0
