"""What was handed out and is not back yet. A lease ends with its result, at its deadline, or when it is evidently lost."""

from __future__ import annotations

import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from service.scheduling.incoming.results import Position
from service.scheduling.jobs.plan import Range

__all__ = ["UNSEEN_ALLOWED", "Lease", "Leases"]

HELD_FACTOR = 4
UNSEEN_ALLOWED = 3  # looks, one a second


@dataclass
class Lease:
    """A batch of a job, or (without a range) the preparing of a scene, in somebody's hands."""

    owner: str  # the job or the scene
    kind: str
    batch: Range | None
    patience_s: float  # until it is handed out again
    expected_s: float = 0.0
    id: str = field(default_factory=lambda: uuid.uuid4().hex)
    issued: float = field(default_factory=time.monotonic)
    holder: str | None = None  # the worker that was last seen with it
    held_since: float | None = None  # since somebody was first seen with it
    is_held: bool = False  # whether it was seen there at the last look
    unseen: int = 0  # looks in a row at which it neither waited nor was worked on
    answered_by: Position | None = None  # the results' end when it was plainly unseen: its answer, if there is one, lies before
    has_arrived: bool = False  # its answer was read, and is stored as soon as the film takes it
    waited: float = 0.0  # when it was last seen in its queue
    is_away: bool = False  # whether who has it does not report itself, though Redis knows that it lives
    has_begun: bool = False  # whether a slot was seen at work on it
    is_rendered: bool = False  # of a joint: its slot does something else by now, and its sums wait for the others on the machine
    doubled: bool = False
    queue: str = ""  # in which its message waits, or waited
    only: str = ""  # the worker that alone takes from that queue
    charged_s: float = 0.0  # to its share, for what it takes of a slot
    message: str = ""  # with which it was sent: its own, unless it went with others
    is_joint: bool = False  # those in its message are rendered at a time, by slots of one machine, and not in turn by one slot

    def __post_init__(self) -> None:
        """Alone, unless told."""
        self.message = self.message or self.id

    @property
    def turn(self) -> str:
        """What takes a slot: a message, or of a joint one each batch."""
        return self.id if self.is_joint else self.message

    @property
    def takes_a_slot(self) -> bool:
        """Whether it counts among what is out: not once it is rendered, as far as is known, and not while who has it is away."""
        return self.batch is not None and not (self.has_arrived or self.is_away or self.is_rendered)

    @property
    def is_overdue(self) -> bool:
        """Whether to wait no longer, since it was taken from its queue. What a worker says it works on gets more time: a tile may
        be slower than was guessed."""
        patience = self.patience_s * (HELD_FACTOR if self.is_held else 1)
        return time.monotonic() - max(self.issued, self.waited) > patience

    def travelled_s(self, seconds: float) -> float:
        """How long its sums were on their way, as far as is known, where rendering them took so long. 0 for those that waited for
        others on their machine, and for what came before anybody was seen with it."""
        return 0.0 if self.is_joint or self.held_since is None else max(time.monotonic() - self.held_since - seconds, 0.0)

    def seen(self, is_seen: bool, end: Callable[[], Position], allowed: float = UNSEEN_ALLOWED) -> None:
        """Note whether it waits or is worked on at this look. end: of the results; looked up after the look. allowed: looks at
        which it may not be.

        What is first unseen may be in the hands of a worker that has not said so yet, and be answered by the next look: the end
        counts that the last of these looks found.
        """
        if is_seen:
            self.unseen, self.answered_by = 0, None
            return
        self.unseen += 1
        if self.answered_by is None or self.unseen <= allowed:
            self.answered_by = end()


class Leases:
    """All leases, by id and by owner. How many slots what is out takes is counted as it changes: it is asked for at every step,
    and there are thousands."""

    def __init__(self) -> None:
        self._all: dict[str, Lease] = {}
        self._of: dict[str, dict[str, Lease]] = {}
        self._turns: Counter[tuple[str, str]] = Counter()  # batches of each owner's turns whose answers were not read yet
        self._held: Counter[str] = Counter()
        self._waiting: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()

    def __iter__(self) -> Iterator[Lease]:
        return iter(list(self._all.values()))

    def __len__(self) -> int:
        return len(self._all)

    def add(self, lease: Lease) -> None:
        """Begin a lease."""
        self._all[lease.id] = lease
        self._of.setdefault(lease.owner, {})[lease.id] = lease
        if lease.takes_a_slot:
            self._take_up(lease)

    def get(self, lease: str) -> Lease | None:
        """The lease of this id."""
        return self._all.get(lease)

    def arrived(self, lease: Lease) -> None:
        """The answer of one of these was read."""
        if lease.takes_a_slot:
            self._let_go(lease)
        lease.has_arrived = True

    def looked_at(self, lease: Lease, is_away: bool, is_rendered: bool) -> None:
        """is_away: who has it does not report itself. Meanwhile others are given what it would have been given."""
        took = lease.takes_a_slot
        lease.is_away, lease.is_rendered = is_away, is_rendered
        if took and not lease.takes_a_slot:
            self._let_go(lease)
        elif lease.takes_a_slot and not took:
            self._take_up(lease)

    def end(self, lease: str) -> Lease | None:
        """End a lease; None where it has ended before."""
        ended = self._all.pop(lease, None)
        if ended is not None:
            of = self._of[ended.owner]
            del of[lease]
            if not of:
                del self._of[ended.owner]
            if ended.takes_a_slot:
                self._let_go(ended)
        return ended

    def of(self, owner: str) -> list[Lease]:
        """The leases of a job or a scene."""
        return list(self._of.get(owner, {}).values())

    def has(self, owner: str) -> bool:
        """Whether there is one of a job or a scene."""
        return owner in self._of

    def held(self) -> Counter[str]:
        """How many slots what is out of each job takes, but for that whose results were read; a copy."""
        return self._held.copy()

    def waiting_in(self, queue: str) -> int:
        """How many slots the batches that went into a queue take, as `turns`."""
        return self._waiting[queue]

    def turns(self, kind: str) -> int:
        """How many slots of workers of a kind all that is out takes, that whose results were not read yet included: where it
        piles up, workers get less."""
        return self._kinds[kind]

    def _take_up(self, lease: Lease) -> None:
        self._turns[lease.owner, lease.turn] += 1
        if self._turns[lease.owner, lease.turn] == 1:
            self._count(lease, 1)

    def _let_go(self, lease: Lease) -> None:
        turn = lease.owner, lease.turn
        self._turns[turn] -= 1
        if not self._turns[turn]:
            del self._turns[turn]
            self._count(lease, -1)

    def _count(self, lease: Lease, change: int) -> None:
        for counter, key in ((self._held, lease.owner), (self._waiting, lease.queue), (self._kinds, lease.kind)):
            counter[key] += change
            if not counter[key]:
                del counter[key]
