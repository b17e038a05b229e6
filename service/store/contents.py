"""In-memory index of a film's file: the samples stored for each tile, and the heads (columns without sums) of the rows."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence

from renderer.settings import Tile
from service.store.coverage import Coverage
from service.store.film_faults import damaged_film_error
from service.store.film_file import RowHead
from service.store.film_version import sample_ranges
from service.store.senders import ANY_WORKER, added_shares, senders_of, shares_of

__all__ = ["Contents"]

FrameTile = tuple[int, int]  # frame, tile


class Contents:
    """The index of one film's rows. Not thread-safe."""

    def __init__(self, heads: Iterable[RowHead], tiles: Sequence[Tile]) -> None:
        """Builds the index from the heads of all rows. Raises FilmLost if they do not fit `tiles`."""
        self._tiles = tiles
        self._coverage: dict[FrameTile, Coverage] = {}
        self._rows: dict[FrameTile, list[RowHead]] = {}
        try:
            for head in heads:
                tiles[head.tile]
                covered = self._coverage.setdefault(head[:2], Coverage())
                for span in sample_ranges(head.first, head.count, head.ranges):
                    covered.add(*span)
                self._rows.setdefault(head[:2], []).append(head)
        except (ValueError, TypeError, IndexError) as error:
            raise damaged_film_error(str(error)) from error

    @property
    def is_empty(self) -> bool:
        """Returns True if the film has no samples in any frame."""
        return not self._coverage

    def coverage_of(self, frame: int, tile: int) -> Coverage:
        """Returns a copy of the stored sample ranges of a tile."""
        known = self._coverage.get((frame, tile))
        return Coverage((a, b - a) for a, b in known.ranges) if known is not None else Coverage()

    def has_tile(self, frame: int, tile: int) -> bool:
        """Returns True if a tile has samples."""
        known = self._coverage.get((frame, tile))
        return known is not None and bool(known.ranges)

    def is_contiguous(self, frame: int, tile: int) -> bool:
        """Returns True if the stored sample numbers of a tile form one contiguous range; False if there are none."""
        return self.has_tile(frame, tile) and len(self._coverage[frame, tile].ranges) == 1

    def copied_coverage(self) -> dict[FrameTile, Coverage]:
        """Returns copies of the stored sample ranges of all tiles, by (frame, tile)."""
        return {where: self.coverage_of(*where) for where in self._coverage}

    def rows(self, frame: int, tile: int) -> Sequence[RowHead]:
        """Returns the heads of a tile's rows."""
        return self._rows.get((frame, tile), [])

    def samples(self, frame: int) -> int:
        """Returns the number of stored samples of a frame, summed over its pixels; includes bad samples."""
        known = ((tile, self._coverage.get((frame, i))) for i, tile in enumerate(self._tiles))
        return sum(covered.total * tile.w * tile.h for tile, covered in known if covered is not None)

    def version(self, frame: int) -> str:
        """Returns a hash of the frame's stored sample ranges. It changes whenever samples are added."""
        known = ((tile, self._coverage.get((frame, tile))) for tile in range(len(self._tiles)))
        covered = [(tile, each.ranges) for tile, each in known if each is not None]
        return hashlib.sha256(repr(covered).encode()).hexdigest()[:20]

    def bad_count(self, frame: int) -> int:
        """Returns the number of samples of a frame that were discarded because they were NaN or infinite."""
        return sum(head.bad for tile in range(len(self._tiles)) for head in self.rows(frame, tile))

    def has_only(self, frames: Collection[int]) -> bool:
        """Returns True if all stored samples belong to these frames, which are given by key."""
        return all(frame in frames for frame, _ in list(self._coverage))

    def has_sums_of(self, worker: str) -> bool:
        """Returns True if the film contains sums from this worker."""
        return any(worker in senders_of(head.workers) for rows in self._rows.values() for head in rows)

    def shares(self, frame: int, tile: int) -> tuple[int, dict[str, int]]:
        """Returns the number of samples per pixel of a tile, and by the worker that rendered them as far as it was recorded."""
        rows = self.rows(frame, tile)
        found = added_shares(shares_of(head.workers, head.count) for head in rows)
        known = {name: samples for name, samples in found.items() if samples and name and name != ANY_WORKER}
        return sum(head.count for head in rows), known

    def record_merge(self, coverage: Mapping[FrameTile, Coverage], added: Iterable[RowHead], replaced: Iterable[RowHead]) -> None:
        """Updates the index after a merge.

        coverage: sample ranges of the changed tiles after the merge. added: heads of the new rows. replaced: heads of the
        deleted rows.
        """
        self._coverage.update(coverage)
        for head in replaced:
            self._rows[head[:2]].remove(head)
        for head in added:
            self._rows.setdefault(head[:2], []).append(head)

    def record_fold(self, heads: Collection[RowHead], merged: RowHead) -> None:
        """Updates the index after several rows of a tile were folded into one.

        heads: heads of the former rows. merged: head of the new row, which has the same samples.
        """
        self._rows[merged[:2]] = [*(head for head in self._rows[merged[:2]] if head not in heads), merged]
