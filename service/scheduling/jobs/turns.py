"""The frames of a job that are to be rendered, by whose turn it is. A shot may have a hundred thousand of them, and who comes
next is asked for every batch: so they are kept in order, and only frames that have changed are looked at again.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping

from service.scheduling.jobs.active_frame import ActiveFrame

__all__ = ["Turn", "Turns"]

SLACK = 64  # entries that say what was before
Turn = tuple[float, ...]  # the less, the sooner
TurnOf = Callable[[ActiveFrame], Turn]


class _Line:
    """Some of the frames, in order. What has changed in the meantime stays in the heap, and is passed over."""

    def __init__(self) -> None:
        self._heap: list[tuple[Turn, int]] = []
        self._turns: dict[int, Turn] = {}  # of those that are in line

    def put(self, key: int, turn: Turn) -> None:
        if self._turns.get(key) != turn:
            self._turns[key] = turn
            heapq.heappush(self._heap, (turn, key))
            if len(self._heap) > 2 * len(self._turns) + SLACK:
                self._heap = [(turn, key) for key, turn in self._turns.items()]
                heapq.heapify(self._heap)

    def leave(self, key: int) -> None:
        self._turns.pop(key, None)

    def first(self) -> tuple[Turn, int] | None:
        while self._heap and not self._is_true(self._heap[0]):
            heapq.heappop(self._heap)
        return self._heap[0] if self._heap else None

    def some(self, most: int) -> list[int]:
        """The first of them."""
        taken: dict[int, tuple[Turn, int]] = {}
        while len(taken) < most and (first := self.first()) is not None:
            taken[first[1]] = heapq.heappop(self._heap)
        for entry in taken.values():
            heapq.heappush(self._heap, entry)
        return list(taken)

    def before(self, turn: Turn, most: int) -> int:
        """How many come before a turn; `most` where there are more."""
        found: set[int] = set()
        look = [0]
        while look and len(found) < most:
            at = look.pop()
            if at < len(self._heap) and self._heap[at][0] < turn:
                if self._is_true(self._heap[at]):
                    found.add(self._heap[at][1])
                look += (2 * at + 1, 2 * at + 2)
        return len(found)

    def _is_true(self, entry: tuple[Turn, int]) -> bool:
        return self._turns.get(entry[1]) == entry[0]


class Turns:
    """Lives in the engine's thread. `note` has to be told of every frame that changes."""

    def __init__(self, frames: Mapping[int, ActiveFrame], turn: TurnOf) -> None:
        """turn: of a frame, as it is now."""
        self._frames = frames
        self._turn = turn
        self._changed: dict[int, None] = {}
        self._ready: dict[str, _Line] = {}  # by kind of workers: those that can be rendered
        self._lacking: dict[str, _Line] = {}  # and those that are to be prepared first, and that nobody prepares yet
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
        self._look()
        return [self._frames[key] for key in self._preparing]

    def owning(self) -> list[ActiveFrame]:
        """The frames for which something was compiled that only they need."""
        self._look()
        return [self._frames[key] for key in self._owning]

    def _line(self, lines: dict[str, _Line], kind: str) -> _Line:
        if kind not in self._ready:
            self._ready[kind], self._lacking[kind] = _Line(), _Line()
            self.note(*self._frames)
        self._look()
        return lines[kind]

    def _look(self) -> None:
        for key in self._changed:
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
                        line.leave(key)
        self._changed = {}

    def _lines(self) -> Iterator[tuple[str, _Line, _Line]]:
        for kind, ready in self._ready.items():
            yield kind, ready, self._lacking[kind]


def _keep(among: dict[int, None], key: int, is_in: bool) -> None:
    if is_in:
        among[key] = None
    else:
        among.pop(key, None)
