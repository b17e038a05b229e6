"""The frames of a job that are to be rendered, by whose turn it is. A shot may have a hundred thousand of them, and who comes
next is asked for every batch: so they are kept in order, and only frames that have changed are looked at again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice

from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.lazy_heap import LazyHeap

__all__ = ["Turn", "Turns"]

Turn = tuple[float, ...]  # the less, the sooner
TurnOf = Callable[[ActiveFrame], Turn]
Line = LazyHeap[Turn]


class Turns:
    """Lives in the engine's thread. `note` has to be told of every frame that changes."""

    def __init__(self, frames: Mapping[int, ActiveFrame], turn: TurnOf) -> None:
        """turn: of a frame, as it is now."""
        self._frames = frames
        self._turn = turn
        self._changed: dict[int, None] = {}
        self._ready: dict[str, Line] = {}  # by kind of workers: those that can be rendered
        self._lacking: dict[str, Line] = {}  # and those that are to be prepared first, and that nobody prepares yet
        self._preparing: dict[int, None] = {}  # those that somebody prepares
        self._owning: dict[int, None] = {}  # those for which something was compiled that only they need
        self.note(*frames)

    def note(self, *keys: int) -> None:
        """Frames have changed."""
        self._changed.update(dict.fromkeys(keys))

    def ready(self, kind: str) -> ActiveFrame | None:
        """The frame that workers of a kind render next; None where no frame that is prepared has work."""
        first = self._line(self._ready, kind).first()
        return None if first is None else self._frames[first[1]]

    def ready_before(self, kind: str, turn: Turn, most: int) -> int:
        """How many of those come before a turn; `most` where there are more."""
        return self._line(self._ready, kind).before(turn, most)

    def lacking(self, kind: str, most: int) -> list[ActiveFrame]:
        """The first frames that are to be prepared for a kind of workers."""
        return [self._frames[key] for key in self._line(self._lacking, kind).some(most)]

    def first_lacking(self, kind: str) -> Turn | None:
        """The turn of the first frame that is not prepared for a kind, whether somebody is at it or not; None: there is none."""
        first = self._line(self._lacking, kind).first()
        at_it = (self._turn(f) for f in self.preparing() if kind not in f.compiled and not f.is_over and not f.is_idle)
        return min(at_it if first is None else (first[0], *at_it), default=None)

    def preparing(self) -> list[ActiveFrame]:
        """The frames that somebody prepares."""
        self.look()
        return [self._frames[key] for key in self._preparing]

    def owning(self) -> list[ActiveFrame]:
        """The frames for which something was compiled that only they need."""
        self.look()
        return [self._frames[key] for key in self._owning]

    def expect(self, kind: str) -> None:
        """Workers of a kind will ask for frames."""
        if kind not in self._ready:
            self._ready[kind], self._lacking[kind] = LazyHeap(), LazyHeap()
            self.note(*self._frames)

    def _line(self, lines: dict[str, Line], kind: str) -> Line:
        self.expect(kind)
        self.look()
        return lines[kind]

    def look(self, most: int | None = None) -> bool:
        """Look at frames that have changed, at so many of them; whether that is all. By itself it happens when it matters."""
        for key in list(islice(self._changed, most)):
            del self._changed[key]
            frame = self._frames[key]
            _keep(self._preparing, key, frame.is_preparing)
            _keep(self._owning, key, bool(frame.own))
            is_open = not frame.is_over and not frame.is_idle
            turn = self._turn(frame) if is_open else ()
            for kind, ready, lacking in self._lines():
                is_ready = kind in frame.compiled
                for line, is_in in ((ready, is_ready), (lacking, not is_ready and not frame.is_preparing)):
                    if is_open and is_in:
                        line.put(key, turn)
                    else:
                        line.drop(key)
        return not self._changed

    def _lines(self) -> Iterator[tuple[str, Line, Line]]:
        for kind, ready in self._ready.items():
            yield kind, ready, self._lacking[kind]


def _keep(among: dict[int, None], key: int, is_in: bool) -> None:
    if is_in:
        among[key] = None
    else:
        among.pop(key, None)
