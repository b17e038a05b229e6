"""Temporally stable denoising of a sequence: a frame is denoised together with its neighbours, once these are rendered."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from renderer.temporal_denoise import DenoisedFrame

__all__ = ["TemporalDenoiser"]

Write = Callable[["npt.NDArray[np.float32]"], None]


class TemporalDenoiser:
    """Denoises the frames of a sequence, and holds frames in memory while they are needed as neighbours.

    The neighbours of a frame depend on the requested frames and on failures, but not on which files existed before.
    """

    def __init__(self, frames: Iterable[float], missing: Iterable[float]) -> None:
        """Creates a denoiser without frames. frames: all requested frames. missing: those whose files must be written."""
        self._all = frozenset(frames)
        self.missing = frozenset(missing)
        self.plan = sorted({*self.missing, *(each for frame in self.missing for each in self._neighbours(frame))})
        self._open = set(self.plan)  # not rendered yet
        self._held: dict[float, DenoisedFrame] = {}
        self._waiting: dict[float, Write] = {}

    def _neighbours(self, frame: float) -> list[float]:
        """Returns the neighbours of a frame: up to DENOISED_REACH consecutive requested frames on each side."""
        from renderer.frames import DENOISED_REACH

        found: list[float] = []
        for way in (-1, 1):
            for step in range(1, DENOISED_REACH + 1):
                if frame + way * step not in self._all:
                    break
                found.append(frame + way * step)
        return found

    def has_neighbours(self, frame: float) -> bool:
        """Returns True if a frame has neighbours."""
        return bool(self._neighbours(frame))

    def add_frame(self, frame: float, still: DenoisedFrame, write: Write) -> None:
        """Adds a rendered frame, whose final picture is computed once its neighbours are rendered.

        still: the frame denoised by itself, with its guides. write: function that writes its denoised picture, if its file is
        missing.
        """
        self._held[frame] = still
        if frame in self.missing:
            self._waiting[frame] = write

    def mark_done(self, frame: float) -> list[tuple[float, Callable[[], None]]]:
        """Marks a frame as rendered or failed.

        Returns the frames that can now be denoised, each with the function that writes it.
        """
        self._open.discard(frame)
        ready = [each for each in sorted(self._waiting) if not self._open.intersection(self._neighbours(each))]
        return [(each, self._writing(each)) for each in ready]

    def _writing(self, frame: float) -> Callable[[], None]:
        def write() -> None:
            from renderer.temporal_denoise import stabilised_frame

            done = self._waiting.pop(frame)
            try:
                done(stabilised_frame(self._held, frame))
            finally:
                wanted = {*self._waiting, *(self._open & self.missing)}
                keep = wanted.union(*(self._neighbours(each) for each in wanted))
                self._held = {each: still for each, still in self._held.items() if each in keep}

        return write
