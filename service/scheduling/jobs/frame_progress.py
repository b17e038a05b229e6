"""Progress of each frame of a job, and the number of frames in each state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from service.scheduling.jobs.active_frame import ActiveFrame, FrameNumbers

__all__ = ["FrameProgress"]


class FrameProgress:
    """Progress numbers of all frames. Call `mark_changed` whenever a frame changes.

    Used only by the engine's thread, except for the mappings that `numbers` returns.
    """

    def __init__(self, frames: Mapping[int, ActiveFrame]) -> None:
        self._frames = frames
        self._numbers: Mapping[int, FrameNumbers] = {}
        self._states: Counter[str] = Counter()
        self._failed: set[int] = set()
        self._changed: set[int] = set()

    def begin(self, frames_per_step: int) -> Iterator[None]:
        """Counts all frames for the first time; yields after each step of `frames_per_step` frames."""
        keys, numbers = list(self._frames), dict[int, FrameNumbers]()
        for at in range(0, len(keys), frames_per_step):
            numbers |= self._numbers_of(keys[at : at + frames_per_step])
            yield
        self._numbers = numbers

    def mark_changed(self, key: int) -> None:
        """Marks a frame as changed, by its key."""
        self._changed.add(key)

    def numbers(self) -> Mapping[int, FrameNumbers]:
        """Returns the progress of each frame by key. The mapping is never modified; a change creates a new one."""
        if self._changed:
            self._numbers = {**self._numbers, **self._numbers_of(self._changed)}
            self._changed = set()
        return self._numbers

    def states(self) -> tuple[Mapping[str, int], tuple[int, ...]]:
        """Returns the number of frames in each state, and the sorted keys of those that failed."""
        return +self._states, tuple(sorted(self._failed))

    def _numbers_of(self, keys: Iterable[int]) -> dict[int, FrameNumbers]:
        now = {key: self._frames[key].numbers() for key in keys}
        for key, numbers in now.items():
            if (before := self._numbers.get(key)) is not None:
                self._states[before.state] -= 1
            self._states[numbers.state] += 1
            (self._failed.add if numbers.state == "failed" else self._failed.discard)(key)
        return now
