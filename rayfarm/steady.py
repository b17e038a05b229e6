"""The denoised frames of a sequence: each is written once its neighbours are rendered, which are used to make it steady."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from renderer.steady import Still

__all__ = ["Steadying"]

Write = Callable[["npt.NDArray[np.float32]"], None]


class Steadying:
    """Holds as many frames as it must. Which neighbours a frame has follows from the frames that are asked for, and from which of
    them fail; not from which were there already.
    """

    def __init__(self, frames: Iterable[float], missing: Iterable[float]) -> None:
        """frames: all that are asked for. missing: those whose files are to be written."""
        self._all = frozenset(frames)
        self.missing = frozenset(missing)
        self.plan = sorted({*self.missing, *(each for frame in self.missing for each in self._near(frame))})
        self._open = set(self.plan)  # not rendered yet
        self._held: dict[float, Still] = {}
        self._waiting: dict[float, Write] = {}

    def _near(self, frame: float) -> list[float]:
        """A frame's neighbours: those that lie in one run with it."""
        from renderer.steady import REACH

        found: list[float] = []
        for way in (-1, 1):
            for step in range(1, REACH + 1):
                if frame + way * step not in self._all:
                    break
                found.append(frame + way * step)
        return found

    def has_neighbours(self, frame: float) -> bool:
        """Whether others count for it."""
        return bool(self._near(frame))

    def take(self, frame: float, still: Still, write: Write) -> None:
        """A frame is rendered. write: writes its denoised picture, where it is missing."""
        self._held[frame] = still
        if frame in self.missing:
            self._waiting[frame] = write

    def settle(self, frame: float) -> list[tuple[float, Callable[[], None]]]:
        """A frame is rendered or has failed: the frames whose denoised pictures can be written now, and what writes each."""
        self._open.discard(frame)
        ready = [each for each in sorted(self._waiting) if not self._open.intersection(self._near(each))]
        return [(each, self._writing(each)) for each in ready]

    def _writing(self, frame: float) -> Callable[[], None]:
        def write() -> None:
            from renderer.steady import steadied

            done = self._waiting.pop(frame)
            try:
                done(steadied(self._held, frame))
            finally:
                wanted = {*self._waiting, *(self._open & self.missing)}
                keep = wanted.union(*(self._near(each) for each in wanted))
                self._held = {each: still for each, still in self._held.items() if each in keep}

        return write
