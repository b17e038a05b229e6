"""Pacing: derives the duration and the number of batches from the rate at which the engine can process results.

With more slots, batches get longer, and several consecutive batches of one tile are dispatched together. No new batches are
dispatched while unread results accumulate.

Processing a result costs about the same for a batch of any size, so a farm of many slots needs longer batches rather than a
faster service.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from service.clock import WorkClock

__all__ = ["BatchSizing"]

RESULTS_TIME_SHARE = 0.5  # fraction of the engine's time for results; the rest is for users, peaks and other programs
SMOOTHING = 0.3
UPDATE_EVERY_S = 1.0
BACKLOG_AGE_S = 0.75  # a backlog of this age is not just a burst
MAX_STRETCH = 20.0
BATCH_GROWTH = 1 / 16  # of the slot-seconds per slot that a job has used, so a batch adds at most this fraction to a picture
MESSAGE_GROWTH = 1 / 4  # the same for messages with several batches, which do not change how often pictures are updated
RECALLABLE_GROWTH = 1.0  # the same for messages that are recalled when other work waits
MESSAGE_SHARE = 0.5  # of a batch's duration, at least, for a message with short batches of several frames
MAX_GROWTH = 3.0  # multiple of the shortest batch; the wait of a new job for a slot
MAX_RECALLABLE_GROWTH = 12.0  # the same for messages that are recalled when a new job or a view waits
RESULT_EVERY_S = 0.25  # interval of a long job's results with few slots, whose batches stay short; longer on a busy machine
ASSUMED_BATCH_COST_S = (
    0.001  # core-seconds per batch, assumed until measured, so that a large farm does not start with short batches
)
MIN_MEASUREMENTS = 8  # minimum number of batches or results for a measurement
WORK_AHEAD_S = 1.0
NOTICE_DELAY_S = 1.25  # mean delay until the service notices a finished part of a tile: a report and a poll, once a second each
MAX_SLOTS_WITH_OWN_TILE = 32  # up to this number of slots, each gets a batch of another tile
MAX_BATCHES_OF_A_TILE = 8
MAX_JOINT_BATCHES = 16
MAX_BATCHES_OF_A_SITE = 64
MIN_HOLD_S = 1.0
CARD_MESSAGE_S = 2.0
MIN_CARD_BATCH_S = 0.02  # of a card; packing and sending the sums of a tile takes a core some milliseconds
GATHER_RATE = 40.0  # results per second; below this rate they are taken in one by one
GATHER_DELAY_S = 0.15


class BatchSizing:
    """Measures the engine's load and computes batch sizes from it. Used only by the engine's thread."""

    def __init__(
        self,
        shortest_s: float,
        longest_s: float,
        unread_bytes: int,
        is_pressed: Callable[[], bool] = lambda: False,
        clock: WorkClock = time,
    ) -> None:
        """Stores the parameters; there are no measurements yet.

        shortest_s, longest_s: bounds on a batch's duration in seconds. unread_bytes: size of the unread results at which
        dispatching stops. is_pressed: returns whether a live view waits for slots, which become free between batches.
        """
        self.is_pressed = is_pressed
        self._clock = clock
        self._shortest_s = shortest_s
        self._longest_s = max(shortest_s, longest_s)
        self._unread_bytes = unread_bytes
        self.batch_cost_s = 0.0  # engine's processor time per batch, also for results of several batches
        self.results_per_s = 0.0
        self._unread = 0
        self._size = 0.0
        self._grown_s = self._shortest_s  # duration of the latest batches
        self._travels: deque[float] = deque(maxlen=2 * MIN_MEASUREMENTS)  # transit times of the latest results, in seconds
        self._stretch = 1.0  # factor for batches while storing waits for a disk or other programs
        self._busy_s = 0.0
        self._storing_s = 0.0  # wall time
        self._results = self._batches = 0
        self._since = self._clock.monotonic()

    @contextmanager
    def measuring(self) -> Iterator[None]:
        """Context manager that measures the processor time that the engine spends on results."""
        begun = self._clock.thread_time()
        try:
            yield
        finally:
            self._busy_s += self._clock.thread_time() - begun

    def record_results(self, results: int, batches: int = 0, seconds: float = 0.0) -> None:
        """Records that results were processed. seconds: wall time spent.

        batches: number of batches in the results, since some results combine several.
        """
        self._results += results
        self._batches += batches
        self._storing_s += seconds
        now = self._clock.monotonic()
        if now - self._since < UPDATE_EVERY_S:
            return
        self.results_per_s = self._results / (now - self._since)
        if (batches := max(self._batches, self._results)) >= MIN_MEASUREMENTS:
            cost = self._busy_s / batches
            self.batch_cost_s += (cost - self.batch_cost_s) * (SMOOTHING if self.batch_cost_s else 1.0)
        # results per second that could be stored
        able = max(self.results_per_s, self._results / self._storing_s if self._storing_s else 0.0)
        behind = self._unread > max(MIN_MEASUREMENTS, BACKLOG_AGE_S * able)
        self._stretch = min(self._stretch * 1.2, MAX_STRETCH) if behind else max(self._stretch * 0.95, 1.0)
        self._busy_s, self._storing_s, self._results, self._batches, self._since = 0.0, 0.0, 0, 0, now

    def record_transit(self, seconds: float) -> None:
        """Records the transit time of a result in seconds. Batches are rendered for at least the typical transit time.

        A slot is idle during the transit. The lower quartile of the latest times is used, so that a first kernel compilation or
        a single slow worker has no effect.
        """
        self._travels.append(seconds)

    @property
    def transit_s(self) -> float:
        """Lower quartile of the latest transit times, in seconds; 0 if too few were recorded."""
        return sorted(self._travels)[len(self._travels) // 4] if len(self._travels) >= MIN_MEASUREMENTS else 0.0

    def batch_s(self, slots: int, spent_s: float = 0.0) -> float:
        """Returns the target duration of a batch in seconds, for a job with this number of slots.

        spent_s: slot-seconds per slot that the job has used so far. The longer a job has run, the longer its batches: its picture
        then changes little from batch to batch, and fewer results save time of the service. Batches stay short if the job has
        few slots, as its picture would be updated too rarely, and while a live view waits for slots.
        """
        most_s = min(MAX_GROWTH * self._shortest_s, slots * RESULT_EVERY_S)
        grown_s = 0.0 if self.is_pressed() else min(spent_s * BATCH_GROWTH, most_s)
        self._grown_s = max(self._shortest_s, grown_s)
        return self._batch_s_at_full_load(slots, self._grown_s)

    @property
    def longest_message_s(self) -> float:
        """The longest duration, in seconds, of a message that other work waits for."""
        return MAX_GROWTH * self._shortest_s

    def message_s(self, batch_s: float, spent_s: float, is_recallable: bool = False) -> float:
        """Returns the target duration, in seconds, of a message with short batches of several frames of a shot.

        batch_s, spent_s: as for `batch_s`. is_recallable: whether the message is recalled when other work needs its slot. A slot
        has no work between two messages. Since each batch is sent as soon as it is rendered, the number of slots does not limit
        the duration; only the wait of new jobs and views for a slot does.
        """
        most_s = MAX_RECALLABLE_GROWTH * self._shortest_s if is_recallable else self.longest_message_s
        growth = RECALLABLE_GROWTH if is_recallable else MESSAGE_GROWTH
        grown_s = 0.0 if self.is_pressed() else min(spent_s * growth, most_s)
        self._grown_s = max(self._grown_s, min(grown_s, self.longest_message_s))  # longer ones are withdrawn from the queue
        return max(MESSAGE_SHARE * batch_s, grown_s)

    def card_message_s(self) -> float:
        """Returns the target duration of a message for a graphics card, in seconds; shorter while a live view waits for slots."""
        return CARD_MESSAGE_S / 4 if self.is_pressed() else CARD_MESSAGE_S

    @staticmethod
    def card_batch_s(message_s: float, tiles: int) -> float:
        """Returns the target duration, in seconds, of a batch of one tile in a message for a graphics card.

        message_s: target duration of the message. tiles: number of the frame's tiles. A message has batches of all tiles, or of
        fewer if each batch would otherwise be too short to be worth a result.
        """
        return min(message_s, max(message_s / tiles, MIN_CARD_BATCH_S))

    def window(self, slots: int, per_slot: int, joint: bool = False) -> int:
        """Returns the maximum number of outstanding messages for this number of slots.

        per_slot: messages per slot, of which one is in progress. The queued ones cover at most about a second of work, so that
        long batches do not delay other jobs.

        joint: whether the sums of a batch wait on their machine for those of other slots. Then some slots are already idle
        while their batches still count as in progress, so the window is larger.
        """
        ahead_s = WORK_AHEAD_S + (NOTICE_DELAY_S if joint and slots > MAX_SLOTS_WITH_OWN_TILE else 0.0)
        return slots + math.ceil(slots * (per_slot - 1) * min(1.0, ahead_s / self._batch_s_at_full_load(slots, self._grown_s)))

    def _batch_s_at_full_load(self, slots: int, shortest_s: float) -> float:
        cost_s = self.batch_cost_s or ASSUMED_BATCH_COST_S
        return min(max(shortest_s, self.transit_s, slots * cost_s / RESULTS_TIME_SHARE) * self._stretch, self._longest_s)

    def batches_of_a_tile(self, slots: int, joint: bool = False) -> int:
        """Returns how many consecutive batches of one tile are dispatched together. Their sums become one row of the film.

        joint: whether the workers add up the sums, instead of the service.
        """
        if joint:
            return min(2 * slots // MAX_SLOTS_WITH_OWN_TILE, MAX_JOINT_BATCHES) if slots > MAX_SLOTS_WITH_OWN_TILE else 1
        return min(max(1, math.ceil(slots / MAX_SLOTS_WITH_OWN_TILE)), MAX_BATCHES_OF_A_TILE)

    @staticmethod
    def hold_s(batch_s: float) -> float:
        """Returns how long, in seconds, the sums of a batch may wait on their machine for the sums to which they are added.

        batch_s: expected duration of each batch in seconds.
        """
        return max(MIN_HOLD_S, batch_s)

    @staticmethod
    def batches_of_a_site(slots: int) -> int:
        """Returns how many consecutive batches of one tile are sent together to a site, which adds up their sums.

        slots: number of slots at the site.
        """
        return max(2, min(slots, MAX_BATCHES_OF_A_SITE))

    @staticmethod
    def site_hold_s(batch_s: float) -> float:
        """Returns how long, in seconds, a site may hold back the sums of a batch in order to add those of later batches to them.

        The time allows for batches that still wait for a free slot at the site. batch_s: expected duration of a batch in seconds.
        """
        return MIN_HOLD_S + 2 * batch_s

    def scaled_room(self, free_slots: int) -> int:
        """Returns the number of batches to dispatch: `free_slots`, reduced linearly with the unread results; 0 at their limit."""
        return int(free_slots * max(0.0, 1.0 - self._unread * self._size / self._unread_bytes)) if free_slots > 0 else free_slots

    def record_unread(self, results: int, size: float) -> None:
        """Records the number of unread results and their mean size in bytes."""
        self._unread, self._size = results, size

    @property
    def unread_results(self) -> int:
        """The number of unread results at the last check."""
        return self._unread

    @property
    def gather_s(self) -> float:
        """Seconds for which results are collected before they are processed together; 0 while results are few."""
        return GATHER_DELAY_S if self.results_per_s >= GATHER_RATE else 0.0
