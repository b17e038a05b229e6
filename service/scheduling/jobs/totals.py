"""Totals over all frames of a job. Updated incrementally, since they are read often and a shot may have very many frames."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import NamedTuple

from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.lazy_heap import LazyHeap

__all__ = ["RunningMaximum", "Totals"]


class RunningMaximum:
    """Maximum of a set of values that change. It is unknown (None) while any of the values is unknown."""

    def __init__(self) -> None:
        self._known = LazyHeap[float]()  # negated values
        self._unknown: set[int] = set()

    def set(self, key: int, value: float | None) -> None:
        """Sets the value of a key; None if the value is unknown."""
        if value is None:
            self._known.drop(key)
            self._unknown.add(key)
        else:
            self._known.put(key, -value)
            self._unknown.discard(key)

    def remove(self, key: int) -> None:
        """Removes the value of a key."""
        self._known.drop(key)
        self._unknown.discard(key)

    @property
    def value(self) -> float | None:
        """The maximum; None if there are no values or any value is unknown."""
        first = None if self._unknown else self._known.smallest()
        return None if first is None else -first[0]


class _CountedFrame(NamedTuple):
    samples: int = 0
    target: int = 0
    is_over: bool = False
    bad: int = 0


class Totals:
    """Totals over a job's frames, as of the latest call of `updated`.

    Failed frames are excluded from the target samples and from both noise values.
    """

    def __init__(self, frames: Mapping[int, ActiveFrame]) -> None:
        self._frames = frames
        self._changed = dict.fromkeys(frames)
        self._counted: dict[int, _CountedFrame] = {}
        self.samples = self.target = self.over = self.bad_samples = 0
        self.noise = RunningMaximum()  # current noise of the frames
        self.ends = RunningMaximum()  # expected final noise of the frames

    def mark_changed(self, key: int) -> None:
        """Marks a frame as changed."""
        self._changed[key] = None

    def updated(self) -> Totals:
        """Updates the totals from all changed frames, and returns this object."""
        self.count()
        return self

    def count(self, max_count: int | None = None) -> bool:
        """Updates the totals from at most `max_count` changed frames (None: all). Returns True if no changed frame is left."""
        for key in list(islice(self._changed, max_count)):
            del self._changed[key]
            frame = self._frames[key]
            before = self._counted.get(key, _CountedFrame())
            has_failed = frame.state == "failed"
            now = _CountedFrame(frame.samples, 0 if has_failed else frame.target_samples, frame.is_over, frame.bad_samples)
            self._counted[key] = now
            self.samples += now.samples - before.samples
            self.target += now.target - before.target
            self.over += now.is_over - before.is_over
            self.bad_samples += now.bad - before.bad
            if has_failed:
                self.noise.remove(key)
                self.ends.remove(key)
            else:
                self.noise.set(key, frame.noise)
                left = (now.samples / max(now.target, 1)) ** 0.5
                self.ends.set(key, None if frame.noise is None else frame.noise * left)
        return not self._changed
