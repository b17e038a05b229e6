"""Notifications of changes for clients: published from any thread, received by listeners on the event loop.

A listener holds sets of changed items instead of a list of messages, so a slow listener gets fewer and newer notifications and
needs no more memory.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import Iterator
from itertools import count

from service.events import Events, ItemChanged, RowWritten, TilesChanged

__all__ = ["Broadcast", "Listener"]


class Listener:
    """A client's set of items that changed since they were last read. Used on the event loop only.

    job: id of the job whose changes are collected; None: changes of all jobs, scenes and workers. frame: key of the frame whose
    changed tiles are collected (2 * frame number).
    """

    def __init__(self, job: str | None, frame: int) -> None:
        self.job = job
        self.frame = frame
        self.changed: dict[tuple[str, str], None] = {}  # ("job" | "scene" | "worker", id), in the order of their first change
        self.tiles: dict[int, None] = {}
        self._wake = asyncio.Event()

    def wake(self) -> None:
        """Makes a pending `wait` return."""
        self._wake.set()

    async def wait(self, seconds: float) -> None:
        """Waits until something has changed, at most this many seconds."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._wake.wait(), seconds)
        self._wake.clear()

    async def collect_for(self, seconds: float) -> None:
        """Waits this many seconds while changes accumulate. The next `wait` returns at once."""
        await asyncio.sleep(seconds)
        self._wake.set()


class _JobListeners:
    """The listeners to one job, with a change counter for the job and one for each of its tiles."""

    def __init__(self, life: int) -> None:
        self.life = life  # distinguishes counters after all listeners had left: uncounted changes may lie between
        self.listeners: set[Listener] = set()
        self.changes = 0
        self.tiles: Counter[tuple[int, int]] = Counter()  # by frame and tile


class Broadcast:
    """Passes notifications of changes to all listeners, which are clients that watch a job or the farm.

    `report_change` and `report_tiles` are thread-safe, and cheap if there are no listeners. The other methods are used on the
    event loop only, except `close`.
    """

    def __init__(self, events: Events) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._everything: set[Listener] = set()
        self._of_job: dict[str, _JobListeners] = {}
        self._lives = count(1)
        self.watchers = 0  # listeners of jobs
        self.closing = False
        events.subscribe(RowWritten, lambda event: self.report_change(event.kind, event.id))
        events.subscribe(ItemChanged, lambda event: self.report_change(event.kind, event.id))
        events.subscribe(TilesChanged, lambda event: self.report_tiles(event.job, event.frame, event.tiles))

    def open(self, loop: asyncio.AbstractEventLoop) -> None:
        """Starts delivering notifications on this event loop."""
        self._loop = loop

    def close(self) -> None:
        """Marks the broadcast as closing and wakes all listeners. Safe to call in a signal handler."""
        self.closing = True
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._wake_all)

    @contextlib.contextmanager
    def listen(self, job: str | None = None, frame: int = 0) -> Iterator[Listener]:
        """Context manager that yields a new listener, which collects changes until the block ends.

        job: id of the job to listen to; None: the listener gets changes of all jobs, scenes and workers, but no tiles. frame:
        key of the frame whose changed tiles it gets: 2 * frame number, since frame numbers are multiples of 0.5.
        """
        listener = Listener(job, frame)
        group = self._everything if job is None else self._of_job.setdefault(job, _JobListeners(next(self._lives))).listeners
        group.add(listener)
        self.watchers += job is not None
        try:
            yield listener
        finally:
            group.discard(listener)
            self.watchers -= job is not None
            if job is not None and not group:
                self._of_job.pop(job, None)

    @property
    def listeners(self) -> int:
        """Number of listeners."""
        return len(self._everything) + self.watchers

    def version(self, job: str, frame: int, tile: int) -> tuple[int, int]:
        """Returns a value that differs after each reported change of a tile. Valid only while the job has listeners."""
        of = self._of_job[job]
        return of.life, of.tiles[frame, tile]

    def changes(self, job: str) -> tuple[int, int]:
        """Returns a value that differs after each reported change of a job. Valid only while the job has listeners."""
        of = self._of_job[job]
        return of.life, of.changes

    def report_change(self, what: str, id: str) -> None:
        """Notifies listeners that an item has changed. what: "job", "scene" or "worker". id: the item's id."""
        if self._everything or (what == "job" and id in self._of_job):
            self._call_in_loop(self._deliver, what, id)

    def report_tiles(self, job: str, frame: int, tiles: set[int]) -> None:
        """Notifies the job's listeners that tiles of a frame have new samples.

        frame: key of the frame: 2 * frame number, since frame numbers are multiples of 0.5. tiles: indices of the tiles.
        """
        if job in self._of_job:
            self._call_in_loop(self._deliver_tiles, job, frame, tiles)

    def _call_in_loop(self, function, *arguments) -> None:  # type: ignore[no-untyped-def]
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(function, *arguments)

    def _deliver(self, what: str, id: str) -> None:
        of = self._of_job.get(id) if what == "job" else None
        if of is not None:
            of.changes += 1
        for listener in (*self._everything, *(of.listeners if of is not None else ())):
            listener.changed[what, id] = None
            listener.wake()

    def _deliver_tiles(self, job: str, frame: int, tiles: set[int]) -> None:
        if (of := self._of_job.get(job)) is None:
            return
        changed = dict.fromkeys(sorted(tiles))
        of.tiles.update((frame, tile) for tile in changed)
        for listener in of.listeners:
            if listener.frame == frame:
                listener.tiles.update(changed)
                listener.wake()

    def _wake_all(self) -> None:
        for listener in (*self._everything, *(each for of in self._of_job.values() for each in of.listeners)):
            listener.wake()
