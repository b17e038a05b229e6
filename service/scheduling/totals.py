"""Sums over all frames of a job, updated as frames change: they are asked for often, and a shot may have thousands of frames."""

from __future__ import annotations

from collections.abc import Mapping

from service.scheduling.active_frame import ActiveFrame

__all__ = ["Totals"]


class Totals:
    """Of the frames of a job. samples, target, over: as of the latest `renewed`; the target leaves out frames that failed."""

    def __init__(self, frames: Mapping[int, ActiveFrame]) -> None:
        self._frames = frames
        self._changed = dict.fromkeys(frames)
        self._counted: dict[int, tuple[int, int, bool]] = {}
        self.samples = self.target = self.over = 0
        for frame in frames.values():
            frame.on_change = self._note

    def renewed(self) -> Totals:
        """Count what has changed."""
        while self._changed:
            key, _ = self._changed.popitem()
            frame = self._frames[key]
            before = self._counted.get(key, (0, 0, False))
            now = frame.samples, 0 if frame.state == "failed" else frame.target_samples, frame.is_over
            self._counted[key] = now
            self.samples += now[0] - before[0]
            self.target += now[1] - before[1]
            self.over += now[2] - before[2]
        return self

    def _note(self, key: int) -> None:
        self._changed[key] = None
