"""How fast the engine takes in results, and what follows for handing out work: the more slots there are, the longer the
batches; several batches of one tile in a row; and no new ones while unread results pile up.

A result costs about the same however large its batch was, so a farm of many slots needs longer batches, not a faster service.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Pace"]

SHARE = (
    0.5  # of the engine's time that results may take: the rest is for people, for bad moments and for other work on the machine
)
SMOOTHING = 0.3
RENEWED_EVERY_S = 1.0
BEHIND_S = 0.75  # a backlog of so long a time is none that comes with a burst
MOST_STRETCH = 20.0
GROWTH = 1 / 16  # of what a job has taken each slot so far: so a batch adds at most that share to a picture
MOST_GROWN = 3.0  # times the shortest: who comes later waits for a slot so long
SEEN_EVERY_S = 0.25  # a result of a long job: with few slots batches stay short; on a busy machine they take a multiple
FIRST_GUESS_S = 0.001  # of a core a batch: until some have come, a farm of thousands of slots must not begin with short ones
FEW = 8  # batches or results: less say nothing
AHEAD_S = 1.0
UNTOLD_S = 1.25  # after a slot is done with its part of a tile: its machine reports it, and the service looks, once a second each
SLOTS_ALONE = 32  # so many take batches of as many tiles
MOST_OF_A_TILE = 8
MOST_JOINT = 16
MOST_OF_A_SITE = 64
SHORTEST_HOLD_S = 1.0
GATHERED_FROM = 40.0  # results a second: fewer are taken in one by one, as they come
GATHER_S = 0.15


class Pace:
    """Lives in the engine's thread."""

    def __init__(
        self, shortest_s: float, longest_s: float, unread_bytes: int, is_pressed: Callable[[], bool] = lambda: False
    ) -> None:
        """shortest_s, longest_s: bounds of a batch. unread_bytes: of results, beyond which nothing more is handed out.
        is_pressed: whether somebody waits for slots between two batches."""
        self.is_pressed = is_pressed
        self._shortest_s = shortest_s
        self._longest_s = max(shortest_s, longest_s)
        self._unread_bytes = unread_bytes
        self.batch_cost_s = 0.0  # of the engine's processor time, that a batch takes, also where sums of some came as one result
        self.results_per_s = 0.0
        self._unread = 0
        self._size = 0.0
        self._grown_s = self._shortest_s  # of the batches handed out last
        self._travels: deque[float] = deque(maxlen=2 * FEW)  # of the latest results, in seconds
        self._stretch = 1.0  # of batches, where results wait for other things than this thread's work: a disk, other programs
        self._busy_s = 0.0
        self._storing_s = 0.0  # by the wall's clock
        self._results = self._batches = 0
        self._since = time.monotonic()

    @contextmanager
    def busy(self) -> Iterator[None]:
        """The engine does something that comes with results."""
        begun = time.thread_time()
        try:
            yield
        finally:
            self._busy_s += time.thread_time() - begun

    def took_in(self, results: int, batches: int = 0, seconds: float = 0.0) -> None:
        """So many results are dealt with, which took so long. batches: of how many, where some came added up."""
        self._results += results
        self._batches += batches
        self._storing_s += seconds
        now = time.monotonic()
        if now - self._since < RENEWED_EVERY_S:
            return
        self.results_per_s = self._results / (now - self._since)
        if (batches := max(self._batches, self._results)) >= FEW:
            cost = self._busy_s / batches
            self.batch_cost_s += (cost - self.batch_cost_s) * (SMOOTHING if self.batch_cost_s else 1.0)
        able = max(self.results_per_s, self._results / self._storing_s if self._storing_s else 0.0)  # of so many a second
        behind = self._unread > max(FEW, BEHIND_S * able)
        self._stretch = min(self._stretch * 1.2, MOST_STRETCH) if behind else max(self._stretch * 0.95, 1.0)
        self._busy_s, self._storing_s, self._results, self._batches, self._since = 0.0, 0.0, 0, 0, now

    def travelled(self, seconds: float) -> None:
        """A result was so long on its way, for which its slot waits: as long at least it shall render.

        Of the latest, three in four were: a kernel that was compiled first, or one slow worker, says nothing about the line."""
        self._travels.append(seconds)

    @property
    def travel_s(self) -> float:
        """For how long three in four of the latest results were on their way, at least; 0 where few came."""
        return sorted(self._travels)[len(self._travels) // 4] if len(self._travels) >= FEW else 0.0

    def batch_s(self, slots: int, spent_s: float = 0.0) -> float:
        """How long a batch is to take where so many slots work.

        spent_s: what its job has taken each of them so far. In a picture of many samples a few more are not seen, and half as
        many results take half of the service's time. Not with few slots, whose results cost little and whose picture would
        stand still meanwhile; nor while somebody looks at a scene, for whom slots are to be free soon.
        """
        most_s = min(MOST_GROWN * self._shortest_s, slots * SEEN_EVERY_S)
        grown_s = 0.0 if self.is_pressed() else min(spent_s * GROWTH, most_s)
        self._grown_s = max(self._shortest_s, grown_s)
        return self._long_s(slots, self._grown_s)

    def window(self, slots: int, per_slot: int, joint: bool = False) -> int:
        """How many messages may be out for so many slots: what waits behind those in hand is what they take within a second, so
        that longer batches do not make who comes later wait longer.

        joint: sums wait on their machines for those of other slots, so some batches count as in hand whose slots are free."""
        ahead_s = AHEAD_S + (UNTOLD_S if joint and slots > SLOTS_ALONE else 0.0)
        return slots + math.ceil(slots * (per_slot - 1) * min(1.0, ahead_s / self._long_s(slots, self._grown_s)))

    def _long_s(self, slots: int, shortest_s: float) -> float:
        cost_s = self.batch_cost_s or FIRST_GUESS_S
        return min(max(shortest_s, self.travel_s, slots * cost_s / SHARE) * self._stretch, self._longest_s)

    def of_a_tile(self, slots: int, joint: bool = False) -> int:
        """How many batches of a tile are handed out one after the other: they come back together, and are added up to one row.

        joint: by the workers, before they come back."""
        if joint:
            return min(2 * slots // SLOTS_ALONE, MOST_JOINT) if slots > SLOTS_ALONE else 1
        return min(max(1, math.ceil(slots / SLOTS_ALONE)), MOST_OF_A_TILE)

    @staticmethod
    def hold_s(batch_s: float) -> float:
        """How long a batch's sums may wait on a machine for those of the batches with which they are added up, where each is
        expected to take so long."""
        return max(SHORTEST_HOLD_S, batch_s)

    @staticmethod
    def of_a_site(slots: int) -> int:
        """How many batches of a tile follow each other to a site of so many slots, whose machines add up their sums."""
        return max(2, min(slots, MOST_OF_A_SITE))

    @staticmethod
    def site_hold_s(batch_s: float) -> float:
        """How long a batch's sums may wait at a site: some of its run wait for a slot while the first are rendered."""
        return SHORTEST_HOLD_S + 2 * batch_s

    def room(self, room: int) -> int:
        """Of that much room, what is left while results wait unread: less and less, and none at the limit."""
        return int(room * max(0.0, 1.0 - self._unread * self._size / self._unread_bytes)) if room > 0 else room

    def unread(self, results: int, size: float) -> None:
        """So many results of about that many bytes wait unread."""
        self._unread, self._size = results, size

    @property
    def waiting(self) -> int:
        """How many results waited unread at the last look."""
        return self._unread

    @property
    def gather_s(self) -> float:
        """How long results are waited for before those that came are taken in together."""
        return GATHER_S if self.results_per_s >= GATHERED_FROM else 0.0
