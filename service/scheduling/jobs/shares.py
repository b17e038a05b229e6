"""Fair sharing of slot time between jobs of one priority, by weights. Independent of clocks, queues and databases.

Each user's jobs form a share. If an administrator has set a weight or a limit for a project, all of the project's jobs form one
share instead, regardless of the user.

Between shares: start-time fair queueing (Goyal, Vin and Cheng 1996). A share's next batch starts, in virtual time, at the end
of its previous one, or now if it was idle; the earliest start is served, and "now" is the latest start so far. A batch of t
seconds takes t / weight of virtual time, so busy shares get slot-seconds in proportion to their weights. An idle share
accumulates no credit, and the others use its slots. The estimated time of a batch is charged when it is dispatched, and
corrected when it returns.

Within a share: first the late jobs, earliest deadline first; then the job with the fewest outstanding batches, and among those
the one that was served longest ago.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from itertools import count
from typing import Generic, Protocol, TypeVar

__all__ = ["EVERYBODY", "ShareQueue", "ShareableJob", "Shares", "Terms", "share_of"]

EVERYBODY = "everybody"  # the share of jobs without a user, such as all jobs of a farm without authentication
NO_LIMIT = 1 << 30


class ShareableJob(Protocol):
    """Interface of a job: the attributes that determine its order."""

    @property
    def id(self) -> str:
        """The job's id."""

    @property
    def share(self) -> str:
        """Name of the share that the job uses: the slot time of its user or project."""

    @property
    def urgency(self) -> float:
        """The deadline of a late job; infinity for others."""

    @property
    def served(self) -> int:
        """Sequence number of the job's latest batch among the batches of all jobs."""

    @property
    def created(self) -> float:
        """Unix time of the job's creation."""

    @property
    def max_slots(self) -> int | None:
        """Maximum number of slots that the job may use at once; None: no limit."""


Job = TypeVar("Job", bound=ShareableJob)


def share_of(user: str | None, project: str = "", terms: Container[str] = ()) -> str:
    """Returns the name of the share of the farm's slot time that a job uses.

    terms: the names of shares with settings of their own. The job uses its project's share if `terms` contains it, else its
    user's.
    """
    if project and f"project:{project}" in terms:
        return f"project:{project}"
    return f"user:{user}" if user else EVERYBODY


@dataclass(frozen=True)
class Terms:
    """Settings of a user's or project's share: its weight, to which its slots are proportional, and its slot limit."""

    weight: float = 1.0
    max_slots: int | None = None


@dataclass
class _VirtualClock:
    """Virtual time for workers of one kind."""

    now: float = 0.0
    ends: dict[str, float] = field(default_factory=dict)  # virtual end time of each share's latest batch
    served: dict[str, int] = field(default_factory=dict)


class Shares:
    """Slot time used by each share (user or project), by worker kind."""

    def __init__(self) -> None:
        self.terms: Mapping[str, Terms] = {}
        self._clocks: dict[str, _VirtualClock] = {}
        self._turn = count(1)

    def terms_of(self, share: str) -> Terms:
        """Returns the weight and slot limit of a user's or project's share; the defaults if administrators have set none."""
        return self.terms.get(share, _DEFAULT_TERMS)

    def name_of(self, user: str | None, project: str) -> str:
        """Returns the name of the share (of its user or project) that a job uses under the current settings."""
        return share_of(user, project, self.terms)

    def queue_of(self, kind: str, jobs: Iterable[Job], held: Mapping[str, int], shares_held: Counter[str]) -> ShareQueue[Job]:
        """Returns the queue of jobs of one priority for workers of this kind.

        held: number of outstanding messages of each job, by id. shares_held: number of outstanding messages of each share, over
        all priorities and kinds; the queue updates it when work is dispatched.
        """
        return ShareQueue(self, kind, jobs, held, shares_held)

    def start(self, kind: str, share: str) -> tuple[float, int]:
        """Returns the sort key of a share; the share with the smallest key is served next.

        The key is the virtual start time of the share's next batch, and the sequence number of its latest batch.
        """
        clock = self._clocks.setdefault(kind, _VirtualClock())
        return clock.ends.get(share, clock.now), clock.served.get(share, 0)

    def reset_share(self, kind: str, share: str) -> None:
        """Advances the virtual time of an idle or full share to now, so that the share accumulates no credit."""
        clock = self._clocks.setdefault(kind, _VirtualClock())
        clock.ends[share] = max(clock.ends.get(share, 0.0), clock.now)

    def charge(self, kind: str, share: str, seconds: float) -> None:
        """Charges a user's or project's share for a dispatched batch. seconds: expected duration of the batch."""
        clock = self._clocks.setdefault(kind, _VirtualClock())
        begins, _ = self.start(kind, share)
        clock.now = max(clock.now, begins)
        clock.ends[share] = begins + seconds / self.terms_of(share).weight
        clock.served[share] = next(self._turn)

    def correct_charge(self, kind: str, share: str, seconds: float) -> None:
        """Corrects the charge of a share after a batch has returned. seconds: actual minus expected duration."""
        clock = self._clocks.setdefault(kind, _VirtualClock())
        clock.ends[share] = clock.ends.get(share, 0.0) + seconds / self.terms_of(share).weight


_DEFAULT_TERMS = Terms()
_QueueEntry = tuple[float, int, int, float, str]


class ShareQueue(Generic[Job]):
    """Queue of jobs of one priority, ordered by the share (user or project) of each job, then by job.

    Call `record_served` after dispatching work of the job that `next_job` returned. Otherwise the queue skips the job.
    """

    def __init__(
        self, shares: Shares, kind: str, jobs: Iterable[Job], held: Mapping[str, int], shares_held: Counter[str]
    ) -> None:
        self._shares = shares
        self._kind = kind
        self._held = shares_held
        self._queues: dict[str, list[tuple[_QueueEntry, Job]]] = {}
        for job in jobs:
            place = (job.urgency, held.get(job.id, 0), job.served, job.created, job.id)
            self._queues.setdefault(job.share, []).append((place, job))
        for share in self._queues:
            if not shares_held[share]:
                shares.reset_share(kind, share)
        self._turns = [(shares.start(kind, share), share) for share in self._queues]
        heapify(self._turns)
        self._is_heap: set[str] = set()
        self._place: _QueueEntry | None = None  # sort key of the current job
        self.left = 0  # maximum number of further slots for the current job
        self.held = 0  # slots that the current job occupies

    def next_job(self) -> Job | None:
        """Returns the next job; None if no job may use more slots.

        A job for which `record_served` was not called since is not returned again.
        """
        while self._turns:
            share = self._turns[0][1]
            queue = self._queues[share]
            room = self._slots_left(self._shares.terms_of(share).max_slots, self._held[share])
            if room <= 0 or not queue:
                self._shares.reset_share(self._kind, share)
                heappop(self._turns)
                continue
            if share not in self._is_heap:
                self._is_heap.add(share)
                heapify(queue)
            self._place, job = heappop(queue)
            self.held = self._place[1]
            self.left = min(room, self._slots_left(job.max_slots, self._place[1]))
            if self.left > 0:
                return job
        return None

    def record_served(self, job: Job, messages: int, seconds: float) -> None:
        """Records that `messages` of the current job were dispatched, and charges its share for them.

        seconds: expected slot-seconds of these messages.
        """
        assert self._place is not None
        urgency, held, _, created, id = self._place
        share = job.share
        heappush(self._queues[share], ((urgency, held + messages, job.served, created, id), job))
        self._held[share] += messages
        self._shares.charge(self._kind, share, seconds)
        heappop(self._turns)  # its share is still the first, since `next_job` has examined no other
        heappush(self._turns, (self._shares.start(self._kind, share), share))

    @staticmethod
    def _slots_left(limit: int | None, held: int) -> int:
        return NO_LIMIT if limit is None else limit - held
