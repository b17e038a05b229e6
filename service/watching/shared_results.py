"""Results shared by all clients that watch a job: encoded tiles, and the job's state as JSON.

Used on the event loop only. It need not wait for the film to check a cached tile: counters of the tiles' changes show whether
it is current.
"""

from __future__ import annotations

import asyncio
import time
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import anyio
import anyio.to_thread

from renderer.film import CHANNELS, COLOR, SAMPLES, mean
from renderer.image import rgbe9995
from service.store.films import Film
from service.watching.broadcast import Broadcast

__all__ = ["Body", "SharedResults"]

THREADS = 2
STATE_TTL_S = 0.25  # seconds that a state is valid without reported changes: it contains times too
STATE_EVERY_S = 0.25
MANY_VIEWERS = 50  # viewers above which each is updated less often
ROUND_PIXELS = 1 << 20
IN_FLIGHT_BYTES_PER_PIXEL = 2 * 2 * 4  # bytes per pixel: two unacknowledged rounds, each here and in the connection
PACKED_MEMORY_SHARE = 0.5  # share of the memory for packed tiles

PLANES = (*range(CHANNELS)[COLOR], SAMPLES)

T = TypeVar("T")


class Body(NamedTuple):
    """An encoded tile: its index, samples per pixel, and colour as RGB9E5 words (protocol.pictures)."""

    tile: int
    spp: int
    words: bytes


@dataclass(frozen=True)
class _PackedTile:
    film: weakref.ref[Film]  # a reopened film is another object
    version: tuple[int, int]
    body: Body | None


@dataclass(frozen=True)
class _PendingResult:
    film: Film
    version: tuple[int, int]
    task: asyncio.Task[dict[int, Body | None]]


class SharedResults:
    """Cache of results for clients that watch a job.

    memory: approximate limit in bytes, for encoded tiles plus data in transit to clients.
    """

    def __init__(self, broadcast: Broadcast, memory: int) -> None:
        self._broadcast = broadcast
        self._memory = memory
        self._limiter = anyio.CapacityLimiter(THREADS)
        self._packed: OrderedDict[tuple[str, int, int], _PackedTile] = OrderedDict()
        self._bytes = 0
        self._making: dict[tuple[str, int, int], _PendingResult] = {}
        self._cached_results: dict[Hashable, tuple[tuple[int, int], float, asyncio.Task[Any]]] = {}

    @property
    def state_every_s(self) -> float:
        """Minimum time between two state messages of a changing job, in seconds. Increases with the number of viewers."""
        return STATE_EVERY_S * max(1.0, self._broadcast.watchers / MANY_VIEWERS)

    @property
    def round_pixels(self) -> int:
        """Number of pixels in a round, that is in the tiles sent to a viewer at once. Decreases with the number of viewers."""
        watchers = max(self._broadcast.watchers, 1)
        return int(min(ROUND_PIXELS, self._memory * (1 - PACKED_MEMORY_SHARE) / (IN_FLIGHT_BYTES_PER_PIXEL * watchers)))

    async def tiles(self, job: str, film: Film, frame: int, tiles: Iterable[int]) -> list[Body]:
        """Returns the current encodings of those of the given tiles that have samples.

        frame: key of the frame: 2 * frame number, since frame numbers are multiples of 0.5. tiles: indices of the tiles. Raises
        FilmUnavailable, FilmLost and FilmClosed.
        """
        found: dict[int, Body | None] = {}
        tasks: dict[asyncio.Task[dict[int, Body | None]], list[int]] = {}
        missing: dict[int, tuple[int, int]] = {}
        for tile in tiles:
            version = self._broadcast.version(job, frame, tile)
            packed, making = self._packed.get((job, frame, tile)), self._making.get((job, frame, tile))
            if packed is not None and packed.version == version and packed.film() is film:
                self._packed.move_to_end((job, frame, tile))
                found[tile] = packed.body
            elif making is not None and making.version == version and making.film is film:
                tasks.setdefault(making.task, []).append(tile)
            else:
                missing[tile] = version
        if missing:
            task = asyncio.create_task(self._pack(job, film, frame, missing))
            task.add_done_callback(_retrieve_exception)
            for tile, version in missing.items():
                self._making[job, frame, tile] = _PendingResult(film, version, task)
            tasks[task] = list(missing)
        for task, wanted in tasks.items():
            made = await _result(task)
            found.update((tile, made[tile]) for tile in wanted)
        return [body for body in found.values() if body is not None]

    async def shared_result(self, job: str, what: str, make: Callable[[], T]) -> T:
        """Returns the result of `make`, which runs in a thread. Caches it until the job changes, at most STATE_TTL_S seconds.

        what: name of the result within the job.
        """
        changes, now = self._broadcast.changes(job), time.monotonic()
        known = self._cached_results.get((job, what))
        if known is None or known[0] != changes or now - known[1] > STATE_TTL_S or _has_failed(known[2]):
            self._cached_results = {key: each for key, each in self._cached_results.items() if now - each[1] <= STATE_TTL_S}
            task = asyncio.create_task(anyio.to_thread.run_sync(make))
            task.add_done_callback(_retrieve_exception)
            known = self._cached_results[job, what] = (changes, now, task)
        said: T = await _result(known[2])
        return said

    async def _pack(self, job: str, film: Film, frame: int, versions: dict[int, tuple[int, int]]) -> dict[int, Body | None]:
        me = asyncio.current_task()
        try:
            made = await anyio.to_thread.run_sync(_bodies, film, frame, list(versions), limiter=self._limiter)
            for tile, version in versions.items():
                self._cache_packed((job, frame, tile), _PackedTile(weakref.ref(film), version, made[tile]))
            return made
        finally:
            for tile in versions:
                if (making := self._making.get((job, frame, tile))) is not None and making.task is me:
                    del self._making[job, frame, tile]

    def _cache_packed(self, key: tuple[str, int, int], packed: _PackedTile) -> None:
        old = self._packed.pop(key, None)
        if old is not None and old.film() is packed.film() and old.version > packed.version:
            packed = old
        elif old is not None:
            self._bytes += _size(packed) - _size(old)
        else:
            self._bytes += _size(packed)
        self._packed[key] = packed
        while self._bytes > self._memory * PACKED_MEMORY_SHARE and len(self._packed) > 1:
            self._bytes -= _size(self._packed.popitem(last=False)[1])


async def _result(task: asyncio.Task[T]) -> T:
    """Returns the result of a task that several viewers wait for. Cancelling a viewer's wait does not cancel the task."""
    return task.result() if task.done() else await asyncio.shield(task)


def _bodies(film: Film, frame: int, tiles: list[int]) -> dict[int, Body | None]:
    made = ((tile, tile_body(film, frame, tile)) for tile in tiles)
    return {tile: None if body is None else Body(tile, *body) for tile, body in made}


def tile_body(film: Film, frame: int, tile: int) -> tuple[int, bytes] | None:
    """Returns a tile's samples per pixel, and its mean colour as RGB9E5 words; None if it has no samples.

    frame: key of the frame: 2 * frame number, since frame numbers are multiples of 0.5. tile: index of the tile.
    """
    sums = film.tile_planes(frame, tile, PLANES)
    if sums is None:
        return None
    return film.coverage(frame, tile).total, rgbe9995.pack(mean(sums, film.film_exponent)).astype("<u4").tobytes()


def _size(packed: _PackedTile) -> int:
    return 0 if packed.body is None else len(packed.body.words)


def _has_failed(task: asyncio.Task[Any]) -> bool:
    return task.done() and (task.cancelled() or task.exception() is not None)


def _retrieve_exception(task: asyncio.Task[Any]) -> None:
    """Reads the exception of a finished task, so that asyncio does not report it as unhandled if no viewer waits any more."""
    if not task.cancelled():
        task.exception()
