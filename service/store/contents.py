"""What is remembered of a film's file: which samples of each tile are in it, and the heads of the rows that hold them."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence

from renderer.settings import Tile
from service.store.coverage import Coverage
from service.store.film_faults import damaged
from service.store.film_file import Head
from service.store.film_version import spans
from service.store.senders import senders_of

__all__ = ["Contents"]

Where = tuple[int, int]  # frame, tile


class Contents:
    """Not safe to use from several threads at a time."""

    def __init__(self, heads: Iterable[Head], tiles: Sequence[Tile]) -> None:
        """heads: of all rows. Raises FilmLost where they cannot be those of a film of these tiles."""
        self._tiles = tiles
        self._coverage: dict[Where, Coverage] = {}
        self._rows: dict[Where, list[Head]] = {}
        try:
            for head in heads:
                tiles[head.tile]
                covered = self._coverage.setdefault(head[:2], Coverage())
                for span in spans(head.first, head.count, head.ranges):
                    covered.add(*span)
                self._rows.setdefault(head[:2], []).append(head)
        except (ValueError, TypeError, IndexError) as error:
            raise damaged(str(error)) from error

    @property
    def is_empty(self) -> bool:
        """Whether no sample of any frame is in."""
        return not self._coverage

    def covered(self, frame: int, tile: int) -> Coverage:
        """Which samples of a tile are in; a copy."""
        known = self._coverage.get((frame, tile))
        return Coverage((a, b - a) for a, b in known.ranges) if known is not None else Coverage()

    def has(self, frame: int, tile: int) -> bool:
        """Whether any sample of a tile is in."""
        known = self._coverage.get((frame, tile))
        return known is not None and bool(known.ranges)

    def is_one_run(self, frame: int, tile: int) -> bool:
        """Whether the samples of a tile that are in follow each other without a gap."""
        return self.has(frame, tile) and len(self._coverage[frame, tile].ranges) == 1

    def copied(self) -> dict[Where, Coverage]:
        """Which samples of each tile are in."""
        return {where: self.covered(*where) for where in self._coverage}

    def rows(self, frame: int, tile: int) -> Sequence[Head]:
        """The rows of a tile."""
        return self._rows.get((frame, tile), [])

    def samples(self, frame: int) -> int:
        """The samples of a frame that are in, all pixels together, bad ones included."""
        known = ((tile, self._coverage.get((frame, i))) for i, tile in enumerate(self._tiles))
        return sum(covered.total * tile.w * tile.h for tile, covered in known if covered is not None)

    def version(self, frame: int) -> str:
        """A name for a frame's samples: it changes with every one that is added."""
        known = ((tile, self._coverage.get((frame, tile))) for tile in range(len(self._tiles)))
        covered = [(tile, each.ranges) for tile, each in known if each is not None]
        return hashlib.sha256(repr(covered).encode()).hexdigest()[:20]

    def bad_count(self, frame: int) -> int:
        """How many samples of a frame were left out."""
        return sum(head.bad for tile in range(len(self._tiles)) for head in self.rows(frame, tile))

    def has_only(self, frames: Collection[int]) -> bool:
        """Whether all samples are of these frames."""
        return all(frame in frames for frame, _ in list(self._coverage))

    def has_sent(self, worker: str) -> bool:
        """Whether sums of a worker are in it."""
        return any(worker in senders_of(head.workers) for rows in self._rows.values() for head in rows)

    def take(self, coverage: Mapping[Where, Coverage], added: Iterable[Head], instead_of: Iterable[Head]) -> None:
        """Note what was added, and in the place of which rows. coverage: of the tiles that have changed, as it is now."""
        self._coverage.update(coverage)
        for head in instead_of:
            self._rows[head[:2]].remove(head)
        for head in added:
            self._rows.setdefault(head[:2], []).append(head)

    def fold(self, heads: Collection[Head], made: Head) -> None:
        """Note that one row is in the place of these, with the same samples."""
        self._rows[made[:2]] = [*(head for head in self._rows[made[:2]] if head not in heads), made]
