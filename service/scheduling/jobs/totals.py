"""Sums over all frames of a job, updated as frames change: they are asked for often, and a shot may have very many frames."""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from typing import NamedTuple

from service.scheduling.jobs.active_frame import ActiveFrame

__all__ = ["Greatest", "Totals"]

SLACK = 64  # entries that say what was before


class Greatest:
    """The greatest of some numbers that change, of which some may not be known."""

    def __init__(self) -> None:
        self._known: dict[int, float | None] = {}
        self._heap: list[tuple[float, int]] = []
        self._unknown = 0

    def set(self, key: int, value: float | None) -> None:
        """One of them, from now on."""
        if key in self._known and self._known[key] == value:
            return
        self.drop(key)
        self._known[key] = value
        if value is None:
            self._unknown += 1
            return
        heapq.heappush(self._heap, (-value, key))
        if len(self._heap) > 2 * len(self._known) + SLACK:
            self._heap = [(-each, key) for key, each in self._known.items() if each is not None]
            heapq.heapify(self._heap)

    def drop(self, key: int) -> None:
        """One is not among them any more."""
        self._unknown -= self._known.pop(key, 0.0) is None

    @property
    def value(self) -> float | None:
        """The greatest; None where there is none, or some are not known."""
        while self._heap and self._known.get(self._heap[0][1]) != -self._heap[0][0]:
            heapq.heappop(self._heap)
        return -self._heap[0][0] if self._heap and not self._unknown else None


class _Counted(NamedTuple):
    samples: int = 0
    target: int = 0
    is_over: bool = False
    bad: int = 0


class Totals:
    """Of the frames of a job, as of the latest `renewed`.

    The target, the noise and the noise at the end leave out frames that failed.
    """

    def __init__(self, frames: Mapping[int, ActiveFrame]) -> None:
        self._frames = frames
        self._changed = dict.fromkeys(frames)
        self._counted: dict[int, _Counted] = {}
        self.samples = self.target = self.over = self.bad_samples = 0
        self.noise = Greatest()  # of each frame
        self.ends = Greatest()  # and what it is expected to come to

    def note(self, key: int) -> None:
        """A frame has changed."""
        self._changed[key] = None

    def renewed(self) -> Totals:
        """Count what has changed."""
        while self._changed:
            key, _ = self._changed.popitem()
            frame = self._frames[key]
            before = self._counted.get(key, _Counted())
            has_failed = frame.state == "failed"
            now = _Counted(frame.samples, 0 if has_failed else frame.target_samples, frame.is_over, frame.bad_samples)
            self._counted[key] = now
            self.samples += now.samples - before.samples
            self.target += now.target - before.target
            self.over += now.is_over - before.is_over
            self.bad_samples += now.bad - before.bad
            if has_failed:
                self.noise.drop(key)
                self.ends.drop(key)
            else:
                self.noise.set(key, frame.noise)
                left = (now.samples / max(now.target, 1)) ** 0.5
                self.ends.set(key, None if frame.noise is None else frame.noise * left)
        return self
