"""What a frame still needs: which tile is rendered next, and how many samples of it. No clock, no queue, no film.

The first wave is one sample of every tile, from the middle outwards, so that the whole picture is there at once. After that the
tile with the fewest samples comes next, and the more it has the more it gets; tiles in a rectangle that somebody focused on
come before all others. If a noise level was asked for, a tile ends at fixed sample counts only and depends on its own film
alone, so the picture does not depend on which worker was faster.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

from renderer.film import least_samples
from renderer.settings import Tile
from service.store.coverage import Coverage

__all__ = ["FramePlan", "Range", "checkpoints", "first_check"]

FIRST_CHECK = 32  # samples: below it the noise estimate of a tile says little
FIRST_GUESS = 128  # samples that a tile is expected to need before its noise was looked at
GROWTH = 7  # a batch has at most this many times the samples that its tile has

ALONE_UNTIL = 32  # samples: the first come to all tiles alike

_Turn = tuple[int, int, int, int]  # samples at which a tile's turn began, its place from the middle, its index, samples planned
_NOBODY: tuple[tuple[int, int], int] = ((-1, -1), 0)


class Range(NamedTuple):
    """Samples first ... first + count - 1 of a tile, by its index, of a frame (renderer.frames.frame_key)."""

    tile: int
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which nobody needs
    frame: int = 0


def first_check(tile: Tile) -> int:
    """Returns the sample count at which the noise of a tile is estimated first: a power of two, more in tiles of few pixels."""
    check = FIRST_CHECK
    while check < least_samples(tile.w * tile.h):
        check *= 2
    return check


def checkpoints(covered: int, spp: int, noise: float | None, first: int = FIRST_CHECK) -> int:
    """The sample count up to which a tile with `covered` samples is rendered before its noise is looked at.

    first: of the tile (`first_check`).
    """
    if noise is None:
        return spp
    check = first
    while check < covered:
        check *= 2
    return min(check, spp)


class FramePlan:
    """The plan of one frame. `coverage` and `tile_noise` (of a tile by its index) look into its film."""

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
        """What the film has already is planned around. ceiling: samples of a tile beyond which nothing is handed out for now."""
        self.tiles = tiles
        self.ceiling = spp if ceiling is None else ceiling
        self._frame = frame
        self.spp = spp
        self.noise = noise
        self._coverage = coverage
        self._tile_noise = tile_noise
        self._order = _from_the_middle(tiles)
        self._lost: deque[Range] = deque()
        self._open: set[int] = set()
        self._planned = [0] * len(tiles)
        self._limit = [0] * len(tiles)
        self._guess = [spp if noise is None else min(spp, FIRST_GUESS)] * len(tiles)  # where a tile is expected to stop
        self._heap: list[_Turn] = []
        self._focus: frozenset[int] = frozenset()
        self._focused: list[_Turn] = []  # as the heap, of the tiles in focus
        self._following = _NOBODY  # the tile whose turn goes on, and how many of its batches this turn has given
        self.covered = [0] * len(tiles)
        for tile in range(len(tiles)):
            covered = coverage(tile)
            self.covered[tile] = covered.total
            self._planned[tile] = covered.prefix
            self._limit[tile] = checkpoints(covered.prefix, spp, noise, first_check(tiles[tile]))
            if not self._is_complete(tile, covered):
                self._open.add(tile)
                self._go_on(tile, covered.prefix)

    @property
    def done(self) -> bool:
        """Whether every tile has what was asked for."""
        return not self._open

    @property
    def has_first_wave(self) -> bool:
        """Whether every tile has a sample."""
        return all(self.covered)

    def has(self, samples: int) -> bool:
        """Whether every tile has so many samples, or is complete with fewer."""
        return all(self.covered[tile] >= samples for tile in self._open)

    def lacks(self, tile: int, samples: int) -> bool:
        """Whether a tile has fewer samples and is not complete."""
        return tile in self._open and self.covered[tile] < samples

    @property
    def target_samples(self) -> int:
        """What the frame is expected to come to, all pixels together; exact where no noise level ends it."""
        ends = (max(self._guess[i], self._limit[i]) if i in self._open else self.covered[i] for i in range(len(self.tiles)))
        return sum(t.w * t.h * end for t, end in zip(self.tiles, ends, strict=True))

    @property
    def samples(self) -> int:
        """What the frame has, all pixels together."""
        return sum(t.w * t.h * covered for t, covered in zip(self.tiles, self.covered, strict=True))

    def focus(self, tiles: Iterable[int]) -> None:
        """Once every tile has been handed out, these are rendered before the others. What each ends with stays the same."""
        self._focus = frozenset(tiles)
        entries = self._focused + self._heap
        self._focused = [entry for entry in entries if entry[2] in self._focus]
        self._heap = [entry for entry in entries if entry[2] not in self._focus]
        heapq.heapify(self._focused)
        heapq.heapify(self._heap)

    def next(self, samples_wanted: Callable[[int], int], of_a_tile: int = 1) -> Range | None:
        """The next batch, or None where all is handed out. samples_wanted(tile): how many samples suit the workers.

        of_a_tile: so many of one tile follow each other once it has a few samples; they come back together.

        The film is looked at before anything is taken off: where it has to be waited for, that is still the next.
        """
        while self._lost:
            lost = self._lost[0]
            covered = self._coverage(lost.tile)
            self._lost.popleft()
            if not covered.overlaps(lost.first, lost.count):
                return lost
            self._lose_gaps(lost, covered)
        is_first_wave = bool(self._heap) and self._heap[0][0] == 0
        for heap in (self._heap, self._focused) if is_first_wave else (self._focused, self._heap):
            if (batch := self._next_of(heap, samples_wanted, of_a_tile)) is not None:
                return batch
        return None

    def _next_of(self, heap: list[_Turn], samples_wanted: Callable[[int], int], of_a_tile: int) -> Range | None:
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
            most = 1 if start == 0 else min(max(1, samples_wanted(tile)), GROWTH * start)
            left = min(end, self.ceiling) - start
            if left <= 0:  # what lies under the ceiling is there; it is looked at again when that is raised
                self._planned[tile] = start
                self._push(tile)
                continue
            count = left if left <= most else min(most, (left + 1) // 2 if left < 2 * most else most)
            self._planned[tile] = start + count
            if self._planned[tile] < self._limit[tile]:
                following = self._following[1] + 1 if self._following[0] == (tile, turn) else 1
                goes_on = start >= ALONE_UNTIL and following < of_a_tile
                self._following = ((tile, turn), following) if goes_on else _NOBODY
                self._push(tile, turn if goes_on else None)
            return Range(tile, start, count, self._frame)
        return None

    def wants(self, batch: Range) -> bool:
        """Whether these samples belong to the frame: a tile that is complete takes no more, so that its end stays exact."""
        return (
            batch.tile in self._open
            and batch.count > 0
            and batch.first >= 0
            and batch.first + batch.count <= self._limit[batch.tile]
        )

    def lose(self, lost: Range) -> None:
        """A batch did not come back: it is the first to be handed out again."""
        if lost.tile in self._open:
            self._lost.append(lost)

    def settle(self, back: Range) -> None:
        """A batch came back and the film took it or dropped it; the film says what the tile has now.

        Where the film has to be waited for, nothing has changed, and it is called again.
        """
        covered = self._coverage(back.tile)
        is_open = back.tile in self._open
        is_at_limit = is_open and covered.prefix >= self._limit[back.tile]
        is_complete = is_at_limit and self._is_complete(back.tile, covered)
        self.covered[back.tile] = covered.total
        if is_open:
            self._lose_gaps(back, covered)
        if not is_at_limit:
            return
        if is_complete:
            self._open.discard(back.tile)
            return
        self._go_on(back.tile, covered.prefix)

    def _go_on(self, tile: int, prefix: int) -> None:
        if prefix >= self._limit[tile]:
            self._limit[tile] = checkpoints(prefix + 1, self.spp, self.noise, first_check(self.tiles[tile]))
        self._planned[tile] = max(self._planned[tile], prefix)
        self._push(tile)

    def _lose_gaps(self, of: Range, covered: Coverage) -> None:
        for start, end in covered.gaps(of.first, of.first + of.count):
            self._lost.append(Range(of.tile, start, end - start, self._frame))

    def _is_complete(self, tile: int, covered: Coverage) -> bool:
        if covered.prefix >= self.spp:
            return True
        if self.noise is None or covered.prefix < first_check(self.tiles[tile]) or covered.total != self._limit[tile]:
            return False
        noise = self._tile_noise(tile)
        # The standard error falls with the square root of the samples.
        self._guess[tile] = int(min(self.spp, covered.prefix * min((noise / self.noise) ** 2, self.spp)))
        return noise <= self.noise

    def _push(self, tile: int, turn: int | None = None) -> None:
        """turn: before whom it comes next; unless told, before those with more samples."""
        heap = self._focused if tile in self._focus else self._heap
        planned = self._planned[tile]
        heapq.heappush(heap, (planned if turn is None else turn, self._order[tile], tile, planned))


def _from_the_middle(tiles: list[Tile]) -> list[int]:
    """Each tile's place in the order of distance from the frame's middle."""
    middle_x = max(t.x + t.w for t in tiles) / 2
    middle_y = max(t.y + t.h for t in tiles) / 2

    def distance(i: int) -> float:
        return (tiles[i].x + tiles[i].w / 2 - middle_x) ** 2 + (tiles[i].y + tiles[i].h / 2 - middle_y) ** 2

    place = [0] * len(tiles)
    for rank, i in enumerate(sorted(range(len(tiles)), key=distance)):
        place[i] = rank
    return place
