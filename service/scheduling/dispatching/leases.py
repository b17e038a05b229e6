"""Leases: records of outstanding work. A lease ends with its result, at its deadline, or when the work is found to be lost."""

from __future__ import annotations

import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from service.scheduling.incoming.results import Position
from service.scheduling.jobs.plan import Range

__all__ = ["MAX_UNSEEN_POLLS", "Lease", "Leases"]

HELD_DEADLINE_FACTOR = 4
MAX_UNSEEN_POLLS = 3  # polls, one per second


@dataclass
class Lease:
    """A batch of a job that is in a queue or with a worker. Without a batch: other work, such as the preparation of a scene."""

    owner: str  # job or scene
    kind: str
    batch: Range | None
    patience_s: float  # seconds until it is handed out again
    expected_s: float = 0.0
    id: str = field(default_factory=lambda: uuid.uuid4().hex)
    issued: float = field(default_factory=time.monotonic)
    holder: str | None = None  # the worker last seen with it
    held_since: float | None = None  # when a worker was first seen with it
    is_held: bool = False  # whether a worker had it at the latest poll
    unseen: int = 0  # consecutive polls at which it was neither queued nor held
    answered_by: Position | None = None  # end of the results at the last allowed unseen poll; an answer, if any, is before it
    has_arrived: bool = False  # its answer was read, and is stored once the film accepts it
    waited: float = 0.0  # when it was last seen in its queue
    is_away: bool = False  # whether its holder is connected but does not report
    has_begun: bool = False  # whether a slot was seen rendering it
    is_rendered: bool = False  # joint only: its slot is free, and its sums wait for the others on the machine
    doubled: bool = False
    queue: str = ""  # queue of its message
    only: str = ""  # the only worker that serves that queue
    is_of_card: bool = False  # whether `only` renders it with a graphics card
    charged_s: float = 0.0  # slot-seconds charged to its share
    message: str = ""  # id of its message, which may contain other batches
    message_s: float = 0.0  # expected duration of its message, if one slot renders several batches of it; else 0
    is_long: bool = False  # whether its message is recalled when other work waits for a slot
    is_joint: bool = False  # whether the batches of its message are rendered in parallel by slots of one machine

    def __post_init__(self) -> None:
        """Sets the message's id to the lease's own id, unless another was given."""
        self.message = self.message or self.id

    @property
    def slot_unit(self) -> str:
        """Id of the work that occupies one slot: a message, or a single batch of a joint message."""
        return self.id if self.is_joint else self.message

    @property
    def takes_a_slot(self) -> bool:
        """True while the batch occupies a slot.

        This ends when its result has arrived, its sums are rendered, or its worker stops sending reports.
        """
        return self.batch is not None and not (self.has_arrived or self.is_away or self.is_rendered)

    def is_overdue(self, now: float) -> bool:
        """Returns True if the lease's timeout has passed since it was last seen in its queue. now: monotonic time.

        The timeout is multiplied by `HELD_DEADLINE_FACTOR` while a worker reports the lease, since its tile may be slow.
        """
        patience = self.patience_s * (HELD_DEADLINE_FACTOR if self.is_held else 1)
        return now - max(self.issued, self.waited) > patience

    def transit_s(self, seconds: float, now: float) -> float:
        """Returns for how long, in seconds, the lease's sums were in transit; 0 if unknown.

        seconds: rendering time of the batch. now: monotonic time. Unknown for joint batches, whose sums wait for others on
        their machine; for batches of a graphics card, which wait for those before them in their message; and for results that
        arrived before a worker had reported the lease.
        """
        return 0.0 if self.is_joint or self.is_of_card or self.held_since is None else max(now - self.held_since - seconds, 0.0)

    @property
    def waits_in_message(self) -> bool:
        """True if the batch is rendered after others of its message, so `transit_s` would contain their rendering time."""
        return self.message != self.id and not (self.is_joint or self.is_of_card)

    def record_poll(self, is_seen: bool, stream_end: Callable[[], Position], max_unseen: float = MAX_UNSEEN_POLLS) -> None:
        """Records whether a poll found the lease in its queue or with a worker (`is_seen`).

        stream_end: returns the position of the latest result in the stream. max_unseen: number of successive polls that may
        miss the lease.

        A lease that a poll misses may be with a worker that has not reported it yet, and its result may already be in the stream.
        So each missing poll that is allowed stores the end of the stream; all results before it must be read before the lease
        is considered lost.
        """
        if is_seen:
            self.unseen, self.answered_by = 0, None
            return
        self.unseen += 1
        if self.answered_by is None or self.unseen <= max_unseen:
            self.answered_by = stream_end()


class Leases:
    """All leases, by id and by owner (job or scene).

    The number of occupied slots is updated incrementally, since every step reads it and there can be thousands of leases.
    """

    def __init__(self) -> None:
        self._all: dict[str, Lease] = {}
        self._of: dict[str, dict[str, Lease]] = {}
        self._turns: Counter[tuple[str, str]] = Counter()  # batches with unread answers in each unit of each owner
        self._held: Counter[str] = Counter()
        self._waiting: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()
        self._long: dict[str, dict[str, Lease]] = {}  # leases of long messages by worker kind and id

    def __iter__(self) -> Iterator[Lease]:
        return iter(list(self._all.values()))

    def __len__(self) -> int:
        return len(self._all)

    def add(self, lease: Lease) -> None:
        """Adds a lease."""
        self._all[lease.id] = lease
        self._of.setdefault(lease.owner, {})[lease.id] = lease
        if lease.is_long:
            self._long.setdefault(lease.kind, {})[lease.id] = lease
        if lease.takes_a_slot:
            self._occupy(lease)

    def get(self, lease: str) -> Lease | None:
        """Returns the lease with this id; None if it does not exist."""
        return self._all.get(lease)

    def mark_answered(self, lease: Lease) -> None:
        """Marks the lease as answered: its result was read, but may not be stored yet. It no longer occupies a slot."""
        if lease.takes_a_slot:
            self._release_slot(lease)
        lease.has_arrived = True

    def update_state(self, lease: Lease, is_away: bool, is_rendered: bool) -> None:
        """Updates the state of a lease after a poll of the workers.

        is_away: whether the worker that has the batch is connected but sends no reports. The lease then occupies no slot, so
        that other workers get work. is_rendered: whether the batch's sums are complete and wait for those of other batches.
        """
        took = lease.takes_a_slot
        lease.is_away, lease.is_rendered = is_away, is_rendered
        if took and not lease.takes_a_slot:
            self._release_slot(lease)
        elif lease.takes_a_slot and not took:
            self._occupy(lease)

    def end(self, lease: str) -> Lease | None:
        """Removes a lease and returns it; None if it has already ended."""
        ended = self._all.pop(lease, None)
        if ended is not None:
            of = self._of[ended.owner]
            del of[lease]
            self._long.get(ended.kind, {}).pop(lease, None)
            if not of:
                del self._of[ended.owner]
            if ended.takes_a_slot:
                self._release_slot(ended)
        return ended

    def leases_of(self, owner: str) -> list[Lease]:
        """Returns the leases of a job or a scene."""
        return list(self._of.get(owner, {}).values())

    def has_long(self, kind: str) -> bool:
        """Returns True if `long_leases` returns any."""
        return bool(self._long.get(kind))

    def long_leases(self, kind: str) -> list[Lease]:
        """Returns the leases of long messages of a worker kind that were not recalled."""
        return list(self._long.get(kind, {}).values())

    def forget_long(self, kind: str) -> None:
        """Forgets which leases of a worker kind belong to long messages, since these were recalled."""
        self._long.pop(kind, None)

    def has_any(self, owner: str) -> bool:
        """Returns True if a job or a scene has any lease."""
        return owner in self._of

    def slots_by_job(self) -> Counter[str]:
        """Returns the number of slots that each job occupies, by job id. Leases whose results were read are not counted."""
        return self._held.copy()

    def slots_waiting_in(self, queue: str) -> int:
        """Returns the number of slots occupied by the leases of one queue. Leases whose results were read are not counted."""
        return self._waiting[queue]

    def occupied_slots(self, kind: str) -> int:
        """Returns the number of CPU slots of this worker kind that are occupied by leases.

        A lease counts until its result is read. So a backlog of unread results reduces the work that is dispatched.
        """
        return self._kinds[kind]

    def _occupy(self, lease: Lease) -> None:
        self._turns[lease.owner, lease.slot_unit] += 1
        if self._turns[lease.owner, lease.slot_unit] == 1:
            self._count(lease, 1)

    def _release_slot(self, lease: Lease) -> None:
        turn = lease.owner, lease.slot_unit
        self._turns[turn] -= 1
        if not self._turns[turn]:
            del self._turns[turn]
            self._count(lease, -1)

    def _count(self, lease: Lease, change: int) -> None:
        counted = [(self._held, lease.owner), (self._waiting, lease.queue)]
        for counter, key in counted if lease.only else [*counted, (self._kinds, lease.kind)]:
            counter[key] += change
            if not counter[key]:
                del counter[key]
