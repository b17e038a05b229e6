"""Whose batch is next among jobs of one priority: fair shares of the slots' time, by weights. No clock, no queue, no database.

A share is a user's, or a project's if it has been given its own terms: then all its jobs belong to that share, whoever's they
are.

Between shares: start-time fair queueing (Goyal, Vin and Cheng 1996). A share's next batch starts, in virtual time, when its
last one ended, or now if it was idle before; the earliest start is served, and "now" is the latest start so far. A batch of t
seconds takes t / weight of virtual time: shares that always have work get slot seconds in proportion to their weights; an idle
share saves nothing up, and the others use what it does not. The estimated time of a batch is charged when it is handed out, and
corrected when it is back.

Within a share: first the jobs that are expected to miss their deadline, earliest deadline first; then the job with the fewest
batches in hand, and among those the one that has waited longest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from itertools import count
from typing import Generic, Protocol, TypeVar

__all__ = ["EVERYBODY", "Claim", "Line", "Shares", "Terms", "share_of"]

EVERYBODY = "everybody"  # the share of jobs that are nobody's, as all are of a farm that asks nobody who they are
NO_LIMIT = 1 << 30


class Claim(Protocol):
    """What is looked at of a job."""

    @property
    def id(self) -> str:
        """Of the job."""

    @property
    def share(self) -> str:
        """Out of whose share it is rendered."""

    @property
    def urgency(self) -> float:
        """Its deadline where it is expected to miss that, else infinity."""

    @property
    def served(self) -> int:
        """When it was given a batch last, as a place in the order of all batches."""

    @property
    def created(self) -> float:
        """When it was asked for."""

    @property
    def max_slots(self) -> int | None:
        """That may work on it at a time."""


Job = TypeVar("Job", bound=Claim)


def share_of(user: str | None, project: str = "", terms: Container[str] = ()) -> str:
    """Out of whose share a job is rendered: its project's, where that has terms of its own, else its user's."""
    if project and f"project:{project}" in terms:
        return f"project:{project}"
    return f"user:{user}" if user else EVERYBODY


@dataclass(frozen=True)
class Terms:
    """What a share gets: slots in proportion to its weight, at most so many at a time."""

    weight: float = 1.0
    max_slots: int | None = None


@dataclass
class _Clock:
    """Virtual time, of workers of one kind."""

    now: float = 0.0
    ends: dict[str, float] = field(default_factory=dict)  # of each share's latest batch
    served: dict[str, int] = field(default_factory=dict)


class Shares:
    """What each share has had, of the workers of each kind."""

    def __init__(self) -> None:
        self.terms: Mapping[str, Terms] = {}
        self._clocks: dict[str, _Clock] = {}
        self._turn = count(1)

    def of(self, share: str) -> Terms:
        """A share's terms."""
        return self.terms.get(share, _USUAL)

    def name_of(self, user: str | None, project: str) -> str:
        """As `share_of`, by the terms of now."""
        return share_of(user, project, self.terms)

    def line(self, kind: str, jobs: Iterable[Job], held: Mapping[str, int], shares_held: Counter[str]) -> Line[Job]:
        """Jobs of one priority, in line for workers of a kind.

        held: of each job, how many messages with batches are out. shares_held: of each share, whatever their priority and kind;
        what is given is added to it.
        """
        return Line(self, kind, jobs, held, shares_held)

    def start(self, kind: str, share: str) -> tuple[float, int]:
        """When a share's next batch starts in virtual time, and when the share was served last; the less, the sooner."""
        clock = self._clocks.setdefault(kind, _Clock())
        return clock.ends.get(share, clock.now), clock.served.get(share, 0)

    def rest(self, kind: str, share: str) -> None:
        """A share has had nothing to do, or may have no more: it saves nothing up."""
        clock = self._clocks.setdefault(kind, _Clock())
        clock.ends[share] = max(clock.ends.get(share, 0.0), clock.now)

    def serve(self, kind: str, share: str, seconds: float) -> None:
        """A batch that is expected to take so long is handed out."""
        clock = self._clocks.setdefault(kind, _Clock())
        begins, _ = self.start(kind, share)
        clock.now = max(clock.now, begins)
        clock.ends[share] = begins + seconds / self.of(share).weight
        clock.served[share] = next(self._turn)

    def correct(self, kind: str, share: str, seconds: float) -> None:
        """A batch took so many seconds more than was charged for it, or less."""
        clock = self._clocks.setdefault(kind, _Clock())
        clock.ends[share] = clock.ends.get(share, 0.0) + seconds / self.of(share).weight


_USUAL = Terms()
_Place = tuple[float, int, int, float, str]


class Line(Generic[Job]):
    """Who is next. Whoever was given something, or has nothing to be given, is said by `gave` or by nothing."""

    def __init__(
        self, shares: Shares, kind: str, jobs: Iterable[Job], held: Mapping[str, int], shares_held: Counter[str]
    ) -> None:
        self._shares = shares
        self._kind = kind
        self._held = shares_held
        self._queues: dict[str, list[tuple[_Place, Job]]] = {}
        for job in jobs:
            place = (job.urgency, held.get(job.id, 0), job.served, job.created, job.id)
            self._queues.setdefault(job.share, []).append((place, job))
        for share in self._queues:
            if not shares_held[share]:
                shares.rest(kind, share)
        self._turns = [(shares.start(kind, share), share) for share in self._queues]
        heapify(self._turns)
        self._is_heap: set[str] = set()
        self._place: _Place | None = None  # of whose turn it is
        self.left = 0  # how many slots that one may have more at the most
        self.held = 0  # how many it has

    def next(self) -> Job | None:
        """Whose turn it is; None where nobody may have more. Who does not get anything then is not asked again."""
        while self._turns:
            share = self._turns[0][1]
            queue = self._queues[share]
            room = self._room(self._shares.of(share).max_slots, self._held[share])
            if room <= 0 or not queue:
                self._shares.rest(self._kind, share)
                heappop(self._turns)
                continue
            if share not in self._is_heap:
                self._is_heap.add(share)
                heapify(queue)
            self._place, job = heappop(queue)
            self.held = self._place[1]
            self.left = min(room, self._room(job.max_slots, self._place[1]))
            if self.left > 0:
                return job
        return None

    def gave(self, job: Job, messages: int, seconds: float) -> None:
        """Whose turn it is got something, that is expected to take so many seconds of a slot."""
        assert self._place is not None
        urgency, held, _, created, id = self._place
        share = job.share
        heappush(self._queues[share], ((urgency, held + messages, job.served, created, id), job))
        self._held[share] += messages
        self._shares.serve(self._kind, share, seconds)
        heappop(self._turns)  # it is the first: `next` has looked at nobody else since
        heappush(self._turns, (self._shares.start(self._kind, share), share))

    @staticmethod
    def _room(limit: int | None, held: int) -> int:
        return NO_LIMIT if limit is None else limit - held
