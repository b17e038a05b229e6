"""Priority queues of a job's frames.

A shot may have a hundred thousand frames, and each batch needs the next one. So the frames stay sorted, and only changed frames
are sorted again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice

from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.lazy_heap import LazyHeap

__all__ = ["FrameQueue", "SortKey"]

SortKey = tuple[float, ...]  # sort key; the smallest comes first
SortKeyOf = Callable[[ActiveFrame], SortKey]
FrameHeap = LazyHeap[SortKey]


class FrameQueue:
    """Priority queues of a job's frames, by worker kind. Used only by the engine's thread.

    Call `mark_changed` whenever a frame changes.
    """

    def __init__(self, frames: Mapping[int, ActiveFrame], sort_key_of: SortKeyOf) -> None:
        """Creates the queues. sort_key_of: returns the current sort key of a frame; the smallest comes first."""
        self._frames = frames
        self._turn = sort_key_of
        self._changed: dict[int, None] = {}
        self._ready: dict[str, FrameHeap] = {}  # by kind: frames that can be rendered
        self._lacking: dict[str, FrameHeap] = {}  # by kind: frames that are not prepared and not being prepared
        self._unguided: dict[str, FrameHeap] = {}  # by kind: frames that are prepared, but lack their path guide
        self._preparing: dict[int, None] = {}  # frames being prepared
        self._owning: dict[int, None] = {}  # frames with their own compiled scene
        self.mark_changed(*frames)

    def mark_changed(self, *keys: int) -> None:
        """Marks frames as changed, by their keys, so that they are sorted again."""
        self._changed.update(dict.fromkeys(keys))

    def ready_frames(self, kind: str) -> ActiveFrame | None:
        """Returns the next frame to render on workers of this kind; None if no prepared frame has work."""
        first = self._heap_of(self._ready, kind).smallest()
        return None if first is None else self._frames[first[1]]

    def count_ready_before(self, kind: str, sort_key: SortKey, max_count: int) -> int:
        """Returns the number of prepared frames whose sort key is below `sort_key`; at most `max_count`."""
        return self._heap_of(self._ready, kind).count_before(sort_key, max_count)

    def frames_to_prepare(self, kind: str, max_count: int) -> list[ActiveFrame]:
        """Returns the first frames that must be prepared for workers of this kind; at most `max_count`."""
        return [self._frames[key] for key in self._heap_of(self._lacking, kind).first_keys(max_count)]

    def frames_without_guide(self, kind: str, max_count: int) -> list[ActiveFrame]:
        """Returns the first frames that are prepared for workers of this kind, but lack their path guide; at most `max_count`."""
        return [self._frames[key] for key in self._heap_of(self._unguided, kind).first_keys(max_count)]

    def count_without_guide(self, kind: str) -> int:
        """Returns the number of frames that are prepared for workers of this kind, but lack their path guide."""
        return len(self._heap_of(self._unguided, kind))

    def first_unprepared(self, kind: str) -> SortKey | None:
        """Returns the smallest sort key of the frames that are not prepared for this worker kind; None if there are none.

        Frames in preparation, and those that lack their path guide, are included.
        """
        firsts = [self._heap_of(lines, kind).smallest() for lines in (self._lacking, self._unguided)]
        at_it = (self._turn(f) for f in self.preparing_frames() if kind not in f.compiled and not f.is_over and not f.is_idle)
        return min((*(first[0] for first in firsts if first is not None), *at_it), default=None)

    def preparing_frames(self) -> list[ActiveFrame]:
        """Returns the frames that are being prepared."""
        self.update()
        return [self._frames[key] for key in self._preparing]

    def frames_with_own_scene(self) -> list[ActiveFrame]:
        """Returns the frames that have a compiled scene of their own."""
        self.update()
        return [self._frames[key] for key in self._owning]

    def add_kind(self, kind: str) -> None:
        """Creates the queues for a worker kind, unless they exist."""
        if kind not in self._ready:
            self._ready[kind], self._lacking[kind], self._unguided[kind] = LazyHeap(), LazyHeap(), LazyHeap()
            self.mark_changed(*self._frames)

    def _heap_of(self, lines: dict[str, FrameHeap], kind: str) -> FrameHeap:
        self.add_kind(kind)
        self.update()
        return lines[kind]

    def update(self, max_count: int | None = None) -> bool:
        """Sorts at most `max_count` changed frames (None: all). Returns True if no changed frame is left.

        Queries sort all changed frames first.
        """
        for key in list(islice(self._changed, max_count)):
            del self._changed[key]
            frame = self._frames[key]
            _set_membership(self._preparing, key, frame.is_preparing)
            _set_membership(self._owning, key, bool(frame.own))
            is_open = not frame.is_over and not frame.is_idle
            turn = self._turn(frame) if is_open else ()
            for kind, ready, lacking, unguided in self._heaps():
                is_prepared, lacks_guide = kind in frame.compiled, frame.lacks_guide(kind)
                is_lacking = not is_prepared and not frame.is_preparing
                for line, is_in in (
                    (ready, is_prepared and not lacks_guide),
                    (lacking, is_lacking),
                    (unguided, is_prepared and lacks_guide),
                ):
                    if is_open and is_in:
                        line.put(key, turn)
                    else:
                        line.drop(key)
        return not self._changed

    def _heaps(self) -> Iterator[tuple[str, FrameHeap, FrameHeap, FrameHeap]]:
        for kind, ready in self._ready.items():
            yield kind, ready, self._lacking[kind], self._unguided[kind]


def _set_membership(among: dict[int, None], key: int, is_in: bool) -> None:
    if is_in:
        among[key] = None
    else:
        among.pop(key, None)
