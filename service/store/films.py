"""Films: the exact sums of all batches, each stored exactly once.

A job's film is one file. A merged batch is one row: its tile, its range of sample numbers, and its packed sums as received. The
row contains both the sums and the record of their samples, so a batch is never half merged. The order of rows does not matter,
because integer addition is exact. If a tile has many rows, they are folded (added up) into one. A row names the workers whose
sums it contains, so that one worker's samples can be removed. Where that is likely, rows of different workers are not folded
together.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial
from itertools import compress
from pathlib import Path

from protocol.sums import add_sums, check_sums, pack_sums, unpack_sums
from renderer.cryptomatte import Hits, no_hits
from renderer.deep import Deep, no_deep
from renderer.film import BadSample, Sums
from renderer.sentences import Sentence
from renderer.settings import Tile, tiles_of
from service.errors import FilmLost, FilmUnavailable
from service.store.claims import Claims
from service.store.contents import Contents
from service.store.contributions import Contribution, joined_contributions
from service.store.coverage import Coverage
from service.store.film_faults import FilmClosed, film_faults, incomplete_film_error
from service.store.film_file import FilmFile, RowHead, head_sample_ranges
from service.store.film_moment import FilmSnapshotView
from service.store.film_version import FilmShape, Row, sample_ranges
from service.store.row_folding import folded_head, rows_to_fold
from service.store.senders import senders_of, senders_text
from service.store.tile_cache import TileCache
from service.store.tile_sums import deep_of_rows, hits_of_rows, sum_of_rows

__all__ = ["Contribution", "Film"]

log = logging.getLogger(__name__)


class Film:
    """The film of a job: the tiles of its frames, the stored sample ranges, and their sums. Thread-safe.

    FilmStore ensures that a job has only one such object at a time, so the cached index of the file stays valid.
    Methods that read or write raise FilmUnavailable, FilmLost or FilmClosed.
    """

    def __init__(
        self,
        path: Path,
        width: int,
        height: int,
        tile_size: int,
        film_exponent: int,
        cache: TileCache,
        epoch: int | None = None,
        on_use: Callable[[Film], None] = lambda film: None,
        groups: tuple[str, ...] = (),
        ranks: int = 0,
        is_transparent: bool = False,
        deep: int = 0,
    ) -> None:
        """Stores the parameters. The file is opened on demand.

        width, height, tile_size: in pixels. film_exponent: exponent of the fixed-point sums. cache: cache of tiles, shared by
        all films. epoch: number of this service's ownership of the farm, as in FilmFile. on_use: called whenever the file is
        used. groups: names of the light groups (RenderSettings.group_names).
        ranks: RenderSettings.cryptomatte. is_transparent: RenderSettings.is_transparent. deep: RenderSettings.deep.
        """
        self.width = width
        self.height = height
        self.film_exponent = film_exponent
        self.groups = groups
        self.ranks = ranks
        self.is_transparent = is_transparent
        self.deep = deep
        self.tiles = tiles_of(width, height, tile_size)
        self._path = path
        self._shape = FilmShape(width, height, tile_size, film_exponent)
        self._index = {tile: i for i, tile in enumerate(self.tiles)}
        self._cache = cache
        self._epoch = epoch
        self._lock = threading.RLock()
        self._file: FilmFile | None = None
        self._is_closed = False
        self._on_use = on_use
        self._is_known = False  # whether `_contents` is the file's index, also while the file is closed
        self._in_doubt = False  # after a failed write the index must be read again
        self._contents = Contents((), self.tiles)
        self.separates_senders = False  # whether rows of different workers stay separate

    def close(self) -> None:
        """Closes the film permanently."""
        with self._lock:
            self._is_closed = True
            self._cache.evict_film(self._path.stem)
            if self._file is not None:
                self._file.close()

    def open_file(self, create: bool = False) -> None:
        """Opens the film's file if it exists. create: whether to create a missing file, and claim it for writing."""
        with self._lock:
            if self._is_closed:
                raise FilmClosed
            if self._file is None and (create or self._exists()):
                file = FilmFile(self._path, self._shape, self._epoch)
                if create:
                    file.claim()
                self._read_index(file)
                self._file = file
            elif self._file is not None and ((create and self._file.claim()) or self._in_doubt):
                self._read_index(self._file)
            if self._file is not None:
                self._on_use(self)

    def close_file(self) -> bool:
        """Closes the file but keeps its index in memory; the next use opens it again.

        Returns False if another thread uses the film.
        """
        if not self._lock.acquire(blocking=False):
            return False
        try:
            if self._file is not None:
                self._file.close()
                self._file = None
            return True
        finally:
            self._lock.release()

    @property
    def has_file(self) -> bool:
        """Returns True if the film is known to have a file."""
        return self._is_known

    def check_samples(self, recorded: int, frame: int = 0) -> None:
        """Raises FilmLost if a frame has fewer samples than `recorded`."""
        has = self.samples(frame)
        if has < recorded:
            raise incomplete_film_error(has, recorded)

    def checkpoint(self) -> None:
        """Merges the write-ahead log of a film that will not be written soon into the database file."""
        with self._lock:
            if self._file is not None and not self._is_closed:
                self._file.checkpoint()

    def tile_index(self, tile: Tile) -> int | None:
        """Returns a tile's index in `tiles`, or None if the film has no such tile."""
        return self._index.get(tile)

    def coverage(self, frame: int, tile: int) -> Coverage:
        """Returns a copy of the stored sample ranges of a tile."""
        with self._lock:
            return self._open_contents().coverage_of(frame, tile)

    def samples(self, frame: int) -> int:
        """Returns the number of stored samples of a frame, summed over its pixels; includes bad samples."""
        with self._lock:
            return self._open_contents().samples(frame)

    @property
    def is_empty(self) -> bool:
        """Returns True if the film has no samples in any frame."""
        with self._lock:
            return self._open_contents().is_empty

    def version(self, frame: int) -> str:
        """Returns a hash of the frame's stored sample ranges. It changes whenever samples are added."""
        with self._lock:
            return self._open_contents().version(frame)

    def bad_samples(self, frame: int) -> tuple[int, list[BadSample]]:
        """Returns the number of samples of a frame that were discarded as NaN or infinite, and the first of them."""
        with self._lock:
            self.open_file()
            if self._file is None:
                return 0, []
            count, first = self._file.bad_samples(frame)
        return count, [BadSample(*sample) for sample in first]

    def bad_count(self, frame: int) -> int:
        """Returns the number of discarded samples of a frame from the index in memory, without reading the file."""
        with self._lock:
            return self._contents.bad_count(frame)

    def merge(self, contributions: Iterable[Contribution]) -> list[bool]:
        """Adds contributions in one transaction. Returns whether each was accepted. If this raises, none was added.

        A contribution that overlaps stored samples is dropped, unless it contains all of them and more (claims.py). A
        contribution with an unknown tile or damaged sums is dropped too.
        """
        contributions = list(contributions)
        with self._lock:
            self.open_file(create=True)
            is_valid = [
                0 <= contribution.tile < len(self.tiles) and contribution.first >= 0 and contribution.count > 0
                for contribution in contributions
            ]
            try:
                claims, joined = self._accepted_contributions(contributions, is_valid)
            except ValueError:  # At least one part is damaged. Checking each part first would be wasted work in the usual case.
                is_valid = [
                    is_fit and self._has_valid_sums(contribution)
                    for contribution, is_fit in zip(contributions, is_valid, strict=True)
                ]
                claims, joined = self._accepted_contributions(contributions, is_valid)
            if joined:
                bad = [
                    (contribution.frame, *each)
                    for contribution in compress(contributions, claims.taken)
                    for each in contribution.bad
                ]
                self._store_contributions(claims, joined, bad)
            return claims.taken

    def _accepted_contributions(
        self, contributions: list[Contribution], is_valid: list[bool]
    ) -> tuple[Claims, list[tuple[Contribution, Sums | None]]]:
        """Selects the contributions to accept, and joins adjacent ones. Raises ValueError if sums are damaged.

        is_valid: for each contribution, whether it may be accepted.
        """
        claims = Claims(
            contributions, is_valid, self._contents.coverage_of, None if self.separates_senders else self._contents.rows
        )
        return claims, joined_contributions([*compress(contributions, claims.taken)], self.tiles, self.separates_senders)

    def _store_contributions(
        self, claims: Claims, joined: list[tuple[Contribution, Sums | None]], bad: list[tuple[int, int, int, int]]
    ) -> None:
        assert self._file is not None
        heads = [self._head_of(j) for j, _ in joined]
        rows: list[Row] = [(*h[:5], j.sums, *h[5:]) for h, (j, _) in zip(heads, joined, strict=True)]
        try:
            self._file.add(rows, bad, [(head, self.tiles[head.tile]) for head in claims.replaced])
        except BaseException:
            self._in_doubt = True
            raise
        self._contents.record_merge(claims.coverage, heads, claims.replaced)
        for head in claims.replaced:
            self._cache.evict((self._path.stem, *head[:2]))
        for head, (contribution, _) in zip(heads, joined, strict=True):
            grow = partial(add_sums, data=contribution.sums, tile=self.tiles[contribution.tile])
            self._cache.add_samples((self._path.stem, *head[:2]), grow, len(contribution.sums))
        for key in claims.coverage:
            self._fold_tile(*key)

    def has_only(self, frames: Collection[int]) -> bool:
        """Returns True if all stored samples belong to these frames, which are given by key."""
        return self._open_contents().has_only(frames)

    def delete_frames(self, *frames: int) -> None:
        """Deletes all samples of these frames, which are given by key."""
        with self._lock:
            self.open_file()
            if self._file is None:
                return
            self._in_doubt = True
            self._file.delete_frames(frames)
            self._read_index(self._file)

    def delete_damaged(self) -> int:
        """Deletes rows that do not match their checksums, so that their samples are rendered again.

        Returns the number of deleted samples, over all pixels.
        """
        with self._lock:
            self.open_file()
            if self._file is None:
                return 0
            self._in_doubt = True
            broken = [head for head in self._file.row_heads() if not self._is_decodable(self._file.row(*head[:3]), head.tile)]
            return self._delete_rows(broken)

    def has_sums_of(self, worker: str) -> bool:
        """Returns True if the film contains sums from this worker."""
        with self._lock:
            return self._open_contents().has_sums_of(worker)

    def worker_shares(self, frame: int) -> list[tuple[int, dict[str, int]]]:
        """Returns, for each tile of a frame, the number of samples per pixel, in total and by worker.

        The sum over the workers is less than the total if the workers of some samples were not recorded.
        """
        with self._lock:
            contents = self._open_contents()
            return [contents.shares(frame, tile) for tile in range(len(self.tiles))]

    def delete_samples_of(self, worker: str) -> int:
        """Deletes all rows that contain sums of a worker, so that their samples are rendered again.

        Sums of other workers in the same rows are lost too. Returns the number of deleted samples, over all pixels.
        """
        with self._lock:
            self.open_file()
            if self._file is None:
                return 0
            found = [head for head in self._file.row_heads() if worker in senders_of(head.workers)]
            if not found:
                return 0
            self._in_doubt = True
            return self._delete_rows(found)

    def _delete_rows(self, heads: list[RowHead]) -> int:
        """Deletes the rows with these heads. Returns the number of their samples, over all pixels."""
        assert self._file is not None
        self._file.delete_rows(heads)
        for head in heads:
            for first, count in head_sample_ranges(head):
                self._file.delete_bad_samples(head.frame, self.tiles[head.tile], first, count)
        self._read_index(self._file)
        return sum(head.count * self.tiles[head.tile].w * self.tiles[head.tile].h for head in heads)

    def add_recovered(self, rows: Iterable[Row]) -> None:
        """Adds rows that were recovered from a film that cannot be opened. Records of their bad samples are lost."""
        with self._lock:
            self.open_file(create=True)
            assert self._file is not None
            taken = self._contents.copied_coverage()
            self._in_doubt = True
            for row in rows:
                if 0 <= row[1] < len(self.tiles) and self._is_decodable(row, row[1]):
                    covered = taken.setdefault((row[0], row[1]), Coverage())
                    try:
                        for span in sample_ranges(*row[2:4], row[7]):
                            covered.add(*span)
                    except (ValueError, TypeError):
                        continue
                    self._file.add([row], [])
            self._read_index(self._file)

    def _is_decodable(self, row: Row | None, tile: int) -> bool:
        if row is None:
            return False
        try:
            unpack_sums(row[5], self.tiles[tile], stored=True)
            sample_ranges(*row[2:4], row[7])
        except (ValueError, TypeError):
            return False
        return True

    def tile_sums(self, frame: int, tile: int) -> Sums | None:
        """Returns a tile's sums, (planes, h, w) int64, read-only; None if it has no samples."""
        key = (self._path.stem, frame, tile)
        with self._lock:
            self.open_file()
            if self._file is None or not self._contents.has_tile(frame, tile):
                return None
            sums = self._cache.get(key)
            if sums is None:
                sums = sum_of_rows(self._file.sums(frame, tile), self.tiles[tile])
                self._cache.put(key, sums)
            return sums

    def tile_hits(self, frame: int, tile: int) -> Hits:
        """Returns Cryptomatte's counts of a tile; empty if there are none."""
        return hits_of_rows(self._packed_rows(frame, tile), self.tiles[tile]) or no_hits()

    def tile_deep(self, frame: int, tile: int) -> Deep:
        """Returns the deep pixels of a tile; empty if there are none."""
        return deep_of_rows(self._packed_rows(frame, tile), self.tiles[tile]) or no_deep(self.deep)

    def _packed_rows(self, frame: int, tile: int) -> list[bytes]:
        with self._lock:
            self.open_file()
            if self._file is None or not self._contents.has_tile(frame, tile):
                return []
            return list(self._file.sums(frame, tile))

    def tile_planes(self, frame: int, tile: int, planes: Sequence[int]) -> Sums | None:
        """Returns a tile's sums, (channels, h, w) int64; None if it has no samples. Channels not in `planes` are undefined.

        For reading a whole frame: bypasses the cache, whose frequently used tiles would be evicted, and holds the film's lock
        only while the file is read.
        """
        with self._lock:
            self.open_file()
            if self._file is None or not self._contents.has_tile(frame, tile):
                return None
            sums = self._cache.get((self._path.stem, frame, tile))
            packed = [] if sums is not None else list(self._file.sums(frame, tile))
        return sum_of_rows(packed, self.tiles[tile], planes) if sums is None else sums

    def snapshot(self) -> FilmSnapshotView:
        """Returns a snapshot of the film, which stays readable while the film grows.

        Raises FilmUnavailable, also if there is no file yet.
        """
        with self._lock:
            self.open_file()
            if self._file is None:
                raise FilmUnavailable(Sentence("film-without-samples", "The film of this job has no samples yet."))
            shape = self.width, self.height, self.film_exponent, self.tiles
            return FilmSnapshotView(self._path, *shape, self.groups, self.ranks, self.is_transparent, self.deep)

    def _exists(self) -> bool:
        with film_faults():
            return self._path.exists()

    def _open_contents(self) -> Contents:
        """Returns the index of the file, which stays valid while the file cannot be read."""
        if self._is_closed or not self._is_known:
            self.open_file()
        return self._contents

    def _read_index(self, file: FilmFile) -> None:
        """Reads the index from the file, and drops the film's tiles from the cache."""
        self._contents = Contents(file.row_heads(), self.tiles)
        self._cache.evict_film(self._path.stem)
        self._is_known, self._in_doubt = True, False

    def _has_valid_sums(self, contribution: Contribution) -> bool:
        try:
            check_sums(contribution.sums, self.tiles[contribution.tile])
        except ValueError:
            return False
        return True

    def _head_of(self, contribution: Contribution) -> RowHead:
        return RowHead(
            contribution.frame,
            contribution.tile,
            contribution.first,
            contribution.count,
            contribution.bad_count,
            senders_text(contribution.workers),
            None,
        )

    def _fold_tile(self, frame: int, tile: int) -> None:
        """Folds a tile's rows into one row if there are many. Failures are only logged, since the samples are stored anyway."""
        rows, is_contiguous = self._contents.rows(frame, tile), self._contents.is_contiguous(frame, tile)
        try:
            for heads in rows_to_fold(rows, self.separates_senders, is_contiguous):
                self._fold_to_one(heads, len(heads) == len(self._contents.rows(frame, tile)))
        except (FilmUnavailable, FilmLost) as error:
            self._in_doubt = True
            log.warning("the rows of a tile cannot be folded: %s", error)

    def _fold_to_one(self, heads: Sequence[RowHead], is_whole_tile: bool) -> None:
        assert self._file is not None
        made = folded_head(heads)
        frame, tile = made[:2]
        sums = self._cache.get((self._path.stem, frame, tile)) if is_whole_tile else None
        hits, deep = None, None
        if sums is None or self.ranks or self.deep:
            rows = list(self._file.sums(frame, tile) if is_whole_tile else self._file.sums_of(heads))
            sums, hits = sum_of_rows(rows, self.tiles[tile]), hits_of_rows(rows, self.tiles[tile])
            deep = deep_of_rows(rows, self.tiles[tile])
        packed = pack_sums(sums, hits=hits, deep_pixels=deep)
        if self._file.fold_rows(heads, (*made[:5], packed, *made[5:]), is_whole_tile):
            self._contents.record_fold(heads, made)
        else:
            self._in_doubt = True
