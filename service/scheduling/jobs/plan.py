"""The plan of a frame: selects the next tile and its number of samples. Independent of clocks, queues and film files.

The first wave is one sample of every tile, from the centre outwards, so that the whole picture is visible at once. A shot can do
without it where all samples of a tile fit into one batch. After that, the tile with the fewest samples comes next, and batches
grow with the samples of their tile. Tiles in a focus rectangle come
before all others. With a target noise, a tile is completed only at fixed sample counts, depending only on its own film, so the
picture does not depend on the workers' speeds.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from renderer.film import least_samples
from renderer.settings import Tile
from service.store.coverage import Coverage

__all__ = ["FramePlan", "Range", "checkpoints", "first_check"]

FIRST_CHECK_SAMPLES = 32  # samples; noise estimates of fewer are unreliable
ASSUMED_SAMPLES = 128  # samples that a tile is expected to need before its first noise estimate
MAX_BATCH_RATIO = 7  # maximum ratio of a batch's samples to those that its tile has

MIN_SAMPLES_FOR_RUNS = 32  # samples below which no consecutive batches of one tile are made

_HeapEntry = tuple[int, int, int, int]  # samples at the start of the turn, rank from the centre, tile index, planned samples
_NO_WORST_TILE: tuple[tuple[int, int], int] = ((-1, -1), 0)


class Range(NamedTuple):
    """A batch: samples first ... first + count - 1 of one tile (by index) in one frame (by key, renderer.frames.frame_key)."""

    tile: int
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which is not used
    frame: int = 0


def first_check(tile: Tile) -> int:
    """Returns the sample count at which a tile's noise is first estimated: a power of two, larger for tiles of few pixels."""
    check = FIRST_CHECK_SAMPLES
    while check < least_samples(tile.w * tile.h):
        check *= 2
    return check


def checkpoints(covered: int, spp: int, noise: float | None, first: int = FIRST_CHECK_SAMPLES) -> int:
    """Returns the sample count up to which a tile is rendered before its next noise estimate; `spp` without a target noise.

    covered: number of samples that the tile has. spp: maximum number. noise: target noise. first: first checkpoint of the tile.
    """
    if noise is None:
        return spp
    check = first
    while check < covered:
        check *= 2
    return min(check, spp)


class FramePlan:
    """The plan of one frame: which samples of which tile are dispatched next."""

    def __init__(
        self,
        tiles: list[Tile],
        spp: int,
        noise: float | None,
        coverage: Callable[[int], Coverage],
        tile_noise: Callable[[int], float],
        frame: int = 0,
        ceiling: int | None = None,
    ) -> None:
        """Creates a plan for the samples that the film lacks.

        spp, noise: samples per pixel, and target noise. coverage, tile_noise: return the samples and the noise of the tile with
        an index, read from the film. ceiling: samples per pixel up to which batches may be dispatched at present; None: `spp`.
        """
        self.tiles = tiles
        self.ceiling = spp if ceiling is None else ceiling
        self._frame = frame
        self.spp = spp
        self.noise = noise
        self._coverage = coverage
        self._tile_noise = tile_noise
        self._order = _ranks_from_centre(tiles)
        self._lost: deque[Range] = deque()
        self._open: set[int] = set()
        self._planned = [0] * len(tiles)
        self._limit = [0] * len(tiles)
        self._guess = [spp if noise is None else min(spp, ASSUMED_SAMPLES)] * len(tiles)  # expected final samples of each tile
        self._heap: list[_HeapEntry] = []
        self._focus: frozenset[int] = frozenset()
        self._focused: list[_HeapEntry] = []  # heap of the tiles in focus
        self._following = _NO_WORST_TILE  # tile and turn of a run of consecutive batches, and its length
        self.covered = [0] * len(tiles)
        for tile in range(len(tiles)):
            covered = coverage(tile)
            self.covered[tile] = covered.total
            self._planned[tile] = covered.prefix
            self._limit[tile] = checkpoints(covered.prefix, spp, noise, first_check(tiles[tile]))
            if not self._is_complete(tile, covered):
                self._open.add(tile)
                self._requeue_tile(tile, covered.prefix)

    @property
    def is_done(self) -> bool:
        """Returns True if every tile has reached its goal."""
        return not self._open

    @property
    def has_first_wave(self) -> bool:
        """Returns True if every tile has at least one sample."""
        return all(self.covered)

    def every_tile_has(self, samples: int) -> bool:
        """Returns True if every tile has this many samples or is complete with fewer."""
        return all(self.covered[tile] >= samples for tile in self._open)

    def tile_lacks(self, tile: int, samples: int) -> bool:
        """Returns True if a tile is incomplete and has fewer than `samples`."""
        return tile in self._open and self.covered[tile] < samples

    @property
    def target_samples(self) -> int:
        """Expected final number of samples of the frame, over all pixels; exact without a target noise."""
        ends = (max(self._guess[i], self._limit[i]) if i in self._open else self.covered[i] for i in range(len(self.tiles)))
        return sum(t.w * t.h * end for t, end in zip(self.tiles, ends, strict=True))

    def remaining(self) -> Iterator[tuple[int, int]]:
        """Yields the index of each incomplete tile, and its expected remaining samples, over its pixels."""
        for i in self._open:
            yield i, self.tiles[i].w * self.tiles[i].h * max(max(self._guess[i], self._limit[i]) - self.covered[i], 0)

    @property
    def samples(self) -> int:
        """Number of rendered samples of the frame, over all pixels."""
        return sum(t.w * t.h * covered for t, covered in zip(self.tiles, self.covered, strict=True))

    def focus(self, tiles: Iterable[int]) -> None:
        """Sets the tiles that are rendered first after the first wave. Does not change the final samples of any tile."""
        self._focus = frozenset(tiles)
        entries = self._focused + self._heap
        self._focused = [entry for entry in entries if entry[2] in self._focus]
        self._heap = [entry for entry in entries if entry[2] not in self._focus]
        heapq.heapify(self._focused)
        heapq.heapify(self._heap)

    def next_batch(
        self, samples_wanted: Callable[[int], int], max_run: int = 1, at_once: Callable[[int], int] | None = None
    ) -> Range | None:
        """Returns the next batch; None if all are dispatched.

        samples_wanted: returns the suitable number of samples for the tile of an index. max_run: number of successive calls
        that may return consecutive batches of the same tile. at_once: returns the largest number of samples for which all
        samples of a tile are one batch; None: a tile's first batch has one sample.

        The film is queried before the plan is changed, so an error of the film leaves the plan unchanged.
        """
        while self._lost:
            lost = self._lost[0]
            covered = self._coverage(lost.tile)
            self._lost.popleft()
            if not covered.overlaps(lost.first, lost.count):
                return lost
            self._requeue_gaps(lost, covered)
        is_first_wave = bool(self._heap) and self._heap[0][0] == 0
        for heap in (self._heap, self._focused) if is_first_wave else (self._focused, self._heap):
            if (batch := self._next_from(heap, samples_wanted, max_run, at_once)) is not None:
                return batch
        return None

    def _next_from(
        self,
        heap: list[_HeapEntry],
        samples_wanted: Callable[[int], int],
        max_run: int,
        at_once: Callable[[int], int] | None,
    ) -> Range | None:
        while heap:
            turn, _, tile, planned = heap[0]
            if turn >= self.ceiling:
                return None
            if planned >= self.ceiling:
                heapq.heappop(heap)
                self._push(tile)
                continue
            is_current = tile in self._open and planned == self._planned[tile]
            gap = next(self._coverage(tile).gaps(planned, self._limit[tile]), None) if is_current else None
            heapq.heappop(heap)
            if not is_current:
                continue
            if gap is None:
                self._planned[tile] = self._limit[tile]
                continue
            start, end = gap
            left, wanted = min(end, self.ceiling) - start, max(1, samples_wanted(tile))
            is_whole = start == 0 and at_once is not None and left <= max(wanted, at_once(tile))
            most = left if is_whole else max(1, min(wanted, MAX_BATCH_RATIO * start))
            if left <= 0:  # all samples below the ceiling are present; checked again when it rises
                self._planned[tile] = start
                self._push(tile)
                continue
            count = left if left <= most else min(most, (left + 1) // 2 if left < 2 * most else most)
            self._planned[tile] = start + count
            if self._planned[tile] < self._limit[tile]:
                following = self._following[1] + 1 if self._following[0] == (tile, turn) else 1
                goes_on = start >= MIN_SAMPLES_FOR_RUNS and following < max_run
                self._following = ((tile, turn), following) if goes_on else _NO_WORST_TILE
                self._push(tile, turn if goes_on else None)
            return Range(tile, start, count, self._frame)
        return None

    def needs_batch(self, batch: Range) -> bool:
        """Returns True if the frame needs these samples. A complete tile accepts no more, so that its final count is exact."""
        return (
            batch.tile in self._open
            and batch.count > 0
            and batch.first >= 0
            and batch.first + batch.count <= self._limit[batch.tile]
        )

    def requeue(self, lost: Range) -> None:
        """Queues a lost batch, which is then dispatched before all others."""
        if lost.tile in self._open:
            self._lost.append(lost)

    def update_from_film(self, back: Range) -> None:
        """Updates the plan from the film after the batch `back` was merged or dropped.

        An error of the film leaves the plan unchanged; then call it again.
        """
        covered = self._coverage(back.tile)
        is_open = back.tile in self._open
        is_at_limit = is_open and covered.prefix >= self._limit[back.tile]
        is_complete = is_at_limit and self._is_complete(back.tile, covered)
        self.covered[back.tile] = covered.total
        if is_open:
            self._requeue_gaps(back, covered)
        if not is_at_limit:
            return
        if is_complete:
            self._open.discard(back.tile)
            return
        self._requeue_tile(back.tile, covered.prefix)

    def _requeue_tile(self, tile: int, prefix: int) -> None:
        if prefix >= self._limit[tile]:
            self._limit[tile] = checkpoints(prefix + 1, self.spp, self.noise, first_check(self.tiles[tile]))
        self._planned[tile] = max(self._planned[tile], prefix)
        self._push(tile)

    def _requeue_gaps(self, samples: Range, covered: Coverage) -> None:
        for start, end in covered.gaps(samples.first, samples.first + samples.count):
            self._lost.append(Range(samples.tile, start, end - start, self._frame))

    def _is_complete(self, tile: int, covered: Coverage) -> bool:
        if covered.prefix >= self.spp:
            return True
        if self.noise is None or covered.prefix < first_check(self.tiles[tile]) or covered.total != self._limit[tile]:
            return False
        noise = self._tile_noise(tile)
        # The standard error falls with the square root of the samples.
        self._guess[tile] = int(min(self.spp, covered.prefix * min((noise / self.noise) ** 2, self.spp)))
        return noise <= self.noise

    def _push(self, tile: int, sort_key: int | None = None) -> None:
        """Adds a tile to its heap. sort_key: position in the heap; None: the tile's number of planned samples."""
        heap = self._focused if tile in self._focus else self._heap
        planned = self._planned[tile]
        heapq.heappush(heap, (planned if sort_key is None else sort_key, self._order[tile], tile, planned))


def _ranks_from_centre(tiles: list[Tile]) -> list[int]:
    """Returns the rank of each tile by its distance from the frame's centre."""
    middle_x = max(t.x + t.w for t in tiles) / 2
    middle_y = max(t.y + t.h for t in tiles) / 2

    def distance(i: int) -> float:
        return (tiles[i].x + tiles[i].w / 2 - middle_x) ** 2 + (tiles[i].y + tiles[i].h / 2 - middle_y) ** 2

    place = [0] * len(tiles)
    for rank, i in enumerate(sorted(range(len(tiles)), key=distance)):
        place[i] = rank
    return place
