"""Films: the exact sums of every batch, each taken once.

A job's film is one file. A merged batch is one row: its tile, its range of sample numbers, and its packed sums as they arrived.
The row holds the sums and records that they are in, in one write, so nothing can be half merged; and the order of rows does not
matter, since integers add exactly. Tiles with many rows are folded into one. A row names the workers whose sums are in it, so
that one worker's samples can be removed; where that is likely, rows of different workers stay apart.
"""

from __future__ import annotations

import hashlib
import json
import logging
import threading
from collections.abc import Collection, Iterable, Sequence
from functools import partial
from itertools import compress
from pathlib import Path

from renderer.film import BadSample, Sums
from renderer.settings import Tile, tiles_of
from service.errors import FilmLost, FilmWaits
from service.store.added import added_up
from service.store.claims import Claims
from service.store.coverage import Coverage
from service.store.film_faults import FilmClosed, damaged, film_faults, incomplete
from service.store.film_file import FilmFile, Head, head_spans
from service.store.film_moment import FilmMoment
from service.store.film_version import FilmShape, Row, spans
from service.store.parts import Part, joined_parts
from service.store.senders import senders_of, senders_text
from service.store.tile_cache import TileCache
from worker.protocol.sums import add_sums, check_sums, pack_sums, unpack_sums

__all__ = ["Film", "Part"]

FOLD_AT = 8  # rows of a tile, or where they are kept apart of a worker
MOST_APART = 64  # rows of a tile: with more workers than that they are folded all the same

log = logging.getLogger(__name__)


class Film:
    """The film of a job: its frames' tiles, which samples of them are in, and their sums. Safe to use from several threads.

    Of one job there is one such object at a time (FilmStore sees to it), so what it remembers of its file stays true.
    Whatever reads or writes raises FilmWaits, FilmLost or FilmClosed.
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
    ) -> None:
        """Costs nothing: the file is opened when it is needed. epoch: service/store/film_file.py."""
        self.width = width
        self.height = height
        self.film_exponent = film_exponent
        self.tiles = tiles_of(width, height, tile_size)
        self._path = path
        self._shape = FilmShape(width, height, tile_size, film_exponent)
        self._index = {tile: i for i, tile in enumerate(self.tiles)}
        self._cache = cache
        self._epoch = epoch
        self._lock = threading.RLock()
        self._file: FilmFile | None = None
        self._is_closed = False
        self._in_doubt = False  # a write failed: whether its rows are in, the file knows
        self._coverage: dict[tuple[int, int], Coverage] = {}
        self._rows: dict[tuple[int, int], list[Head]] = {}
        self.keeps_apart = False  # what each worker has sent

    def close(self) -> None:
        """Close the film for good."""
        with self._lock:
            self._is_closed = True
            self._cache.forget(self._path.stem)
            if self._file is not None:
                self._file.close()

    def load(self, make: bool = False) -> None:
        """Open the file where it is there; `make`: to write, so also where it is not."""
        with self._lock:
            if self._is_closed:
                raise FilmClosed
            if self._file is None and (make or self._exists()):
                file = FilmFile(self._path, self._shape, self._epoch)
                if make:
                    file.claim()
                self._take_in(file)
                self._file = file
            elif self._file is not None and ((make and self._file.claim()) or self._in_doubt):
                self._take_in(self._file)

    def check(self, recorded: int, frame: int = 0) -> None:
        """Raise FilmLost where the film has fewer samples of a frame than were recorded."""
        has = self.samples(frame)
        if has < recorded:
            raise incomplete(has, recorded)

    def settle(self) -> None:
        """Bring all into the one file, where the film is likely to rest."""
        with self._lock:
            if self._file is not None and not self._is_closed:
                self._file.settle()

    def index_of(self, tile: Tile) -> int | None:
        """A tile's place in `tiles`, or None where the film has no such tile."""
        return self._index.get(tile)

    def coverage(self, frame: int, tile: int) -> Coverage:
        """Which samples of a tile are in; a copy."""
        with self._lock:
            self._known()
            return Coverage((a, b - a) for a, b in self._cover(frame, tile).ranges)

    def samples(self, frame: int) -> int:
        """The samples of a frame that are in, all pixels together, bad ones included."""
        with self._lock:
            self._known()
            known = ((tile, self._coverage.get((frame, i))) for i, tile in enumerate(self.tiles))
            return sum(covered.total * tile.w * tile.h for tile, covered in known if covered is not None)

    @property
    def is_empty(self) -> bool:
        """Whether no sample of any frame is in."""
        with self._lock:
            self._known()
            return not self._coverage

    def version(self, frame: int) -> str:
        """A name for the frame's content: it changes with every sample that is added."""
        with self._lock:
            self._known()
            known = ((tile, self._coverage.get((frame, tile))) for tile in range(len(self.tiles)))
            covered = [(tile, each.ranges) for tile, each in known if each is not None]
        return hashlib.sha256(repr(covered).encode()).hexdigest()[:20]

    def bad_samples(self, frame: int) -> tuple[int, list[BadSample]]:
        """How many samples were NaN or infinite and left out, and the first of them."""
        with self._lock:
            self.load()
            if self._file is None:
                return 0, []
            count, first = self._file.bad_samples(frame)
        return count, [BadSample(*sample) for sample in first]

    def bad_count(self, frame: int) -> int:
        """How many samples of a frame were left out, as far as is known without a look into the file."""
        with self._lock:
            return sum(head.bad for tile in range(len(self.tiles)) for head in self._rows.get((frame, tile), ()))

    def merge(self, parts: Iterable[Part]) -> list[bool]:
        """Add parts in one transaction; for each, whether it was taken. Where this raises, none was.

        A part that overlaps what is in the film is dropped, unless it has all of that and more (claims.py). So is one whose tile
        the film does not have or whose sums are damaged.
        """
        parts = list(parts)
        with self._lock:
            self.load(make=True)
            fit = [0 <= part.tile < len(self.tiles) and part.first >= 0 and part.count > 0 for part in parts]
            try:
                claims, joined = self._joined(parts, fit)
            except ValueError:  # of one, or some: to look at each before is work for nothing where all are as they were sent
                fit = [is_fit and self._is_whole(part) for part, is_fit in zip(parts, fit, strict=True)]
                claims, joined = self._joined(parts, fit)
            if joined:
                bad = [(part.frame, *each) for part in compress(parts, claims.taken) for each in part.bad]
                self._add(claims, joined, bad)
            return claims.taken

    def _joined(self, parts: list[Part], fit: list[bool]) -> tuple[Claims, list[tuple[Part, Sums | None]]]:
        """Those that are to be taken, added up where they follow each other. Raises ValueError where sums are damaged."""
        claims = Claims(parts, fit, self.coverage, None if self.keeps_apart else lambda *where: self._rows.get(where, []))
        return claims, joined_parts([*compress(parts, claims.taken)], self.tiles, self.keeps_apart)

    def _add(self, claims: Claims, joined: list[tuple[Part, Sums | None]], bad: list[tuple[int, int, int, int]]) -> None:
        assert self._file is not None
        heads = [self._head(j) for j, _ in joined]
        rows: list[Row] = [(*h[:5], j.sums, *h[5:]) for h, (j, _) in zip(heads, joined, strict=True)]
        try:
            self._file.add(rows, bad, [(head, self.tiles[head.tile]) for head in claims.replaced])
        except BaseException:
            self._in_doubt = True
            raise
        self._coverage.update(claims.coverage)
        for head in claims.replaced:
            self._rows[head[:2]].remove(head)
            self._cache.drop((self._path.stem, *head[:2]))
        for head, (part, _) in zip(heads, joined, strict=True):
            self._remember(head, part)
        for key in claims.coverage:
            self._fold(*key)

    def has_only(self, frames: Collection[int]) -> bool:
        """Whether all samples are of these frames."""
        self._known()
        return all(frame in frames for frame, _ in list(self._coverage))

    def forget(self, *frames: int) -> None:
        """Remove all samples of these frames."""
        with self._lock:
            self.load()
            if self._file is None:
                return
            self._in_doubt = True
            self._file.forget(frames)
            self._take_in(self._file)

    def heal(self) -> int:
        """Remove what is not what was written, so that it counts as missing; returns how many samples, all pixels together."""
        with self._lock:
            self.load()
            if self._file is None:
                return 0
            self._in_doubt = True
            broken = [head for head in self._file.heads() if not self._is_readable(self._file.row(*head[:3]), head.tile)]
            return self._remove(broken)

    def has_sent(self, worker: str) -> bool:
        """Whether sums of a worker are in it."""
        with self._lock:
            self._known()
            return any(worker in senders_of(head.workers) for rows in self._rows.values() for head in rows)

    def take_back(self, worker: str) -> int:
        """Remove all that a worker has sent, and what was added to it: it counts as missing. Returns how many samples."""
        with self._lock:
            self.load()
            if self._file is None:
                return 0
            found = [head for head in self._file.heads() if worker in senders_of(head.workers)]
            if not found:
                return 0
            self._in_doubt = True
            return self._remove(found)

    def _remove(self, heads: list[Head]) -> int:
        """Remove rows; returns their samples, all pixels together."""
        assert self._file is not None
        self._file.remove(heads)
        for head in heads:
            for first, count in head_spans(head):
                self._file.forget_bad(head.frame, self.tiles[head.tile], first, count)
        self._take_in(self._file)
        return sum(head.count * self.tiles[head.tile].w * self.tiles[head.tile].h for head in heads)

    def take_over(self, rows: Iterable[Row]) -> None:
        """Add rows that are left of a film which cannot be read as a whole. Which of their samples were bad is not told."""
        with self._lock:
            self.load(make=True)
            assert self._file is not None
            taken = {where: Coverage((a, b - a) for a, b in covered.ranges) for where, covered in self._coverage.items()}
            self._in_doubt = True
            for row in rows:
                if 0 <= row[1] < len(self.tiles) and self._is_readable(row, row[1]):
                    covered = taken.setdefault((row[0], row[1]), Coverage())
                    try:
                        for span in spans(*row[2:4], row[7]):
                            covered.add(*span)
                    except (ValueError, TypeError):
                        continue
                    self._file.add([row], [])
            self._take_in(self._file)

    def _is_readable(self, row: Row | None, tile: int) -> bool:
        if row is None:
            return False
        try:
            unpack_sums(row[5], self.tiles[tile], stored=True)
            spans(*row[2:4], row[7])
        except (ValueError, TypeError):
            return False
        return True

    def tile_sums(self, frame: int, tile: int) -> Sums | None:
        """A tile's sums (CHANNELS, h, w) int64, read-only; None where no sample is in yet."""
        key = (self._path.stem, frame, tile)
        with self._lock:
            self.load()
            if self._file is None or not self._cover(frame, tile).ranges:
                return None
            sums = self._cache.get(key)
            if sums is None:
                sums = added_up(self._file.sums(frame, tile), self.tiles[tile])
                self._cache.put(key, sums)
            return sums

    def tile_planes(self, frame: int, tile: int, planes: Sequence[int]) -> Sums | None:
        """As `tile_sums`, with these planes alone; what the others hold means nothing.

        For whoever reads a whole frame: nothing is remembered, which would drive out what is read often, and the film is
        locked for no longer than its file is read.
        """
        with self._lock:
            self.load()
            if self._file is None or not self._cover(frame, tile).ranges:
                return None
            sums = self._cache.get((self._path.stem, frame, tile))
            packed = [] if sums is not None else list(self._file.sums(frame, tile))
        return added_up(packed, self.tiles[tile], planes) if sums is None else sums

    def moment(self) -> FilmMoment:
        """The film as it is now, to be read while it grows on. Raises also FilmWaits where it has no file yet."""
        with self._lock:
            self.load()
            if self._file is None:
                raise FilmWaits("The film of this job has no samples yet.")
            return FilmMoment(self._path, self.width, self.height, self.film_exponent, self.tiles)

    def _cover(self, frame: int, tile: int) -> Coverage:
        return self._coverage.get((frame, tile)) or Coverage()

    def _exists(self) -> bool:
        with film_faults():
            return self._path.exists()

    def _known(self) -> None:
        """See that the file was read once: what is remembered of it is true, also while it cannot be read."""
        if self._is_closed or self._file is None:
            self.load()

    def _take_in(self, file: FilmFile) -> None:
        """Read which samples are in the file."""
        coverage: dict[tuple[int, int], Coverage] = {}
        rows: dict[tuple[int, int], list[Head]] = {}
        try:
            for head in file.heads():
                self.tiles[head.tile]
                covered = coverage.setdefault(head[:2], Coverage())
                for span in spans(head.first, head.count, head.ranges):
                    covered.add(*span)
                rows.setdefault(head[:2], []).append(head)
        except (ValueError, TypeError, IndexError) as error:
            raise damaged(str(error)) from error
        self._coverage, self._rows = coverage, rows
        self._cache.forget(self._path.stem)
        self._in_doubt = False

    def _is_whole(self, part: Part) -> bool:
        try:
            check_sums(part.sums, self.tiles[part.tile])
        except ValueError:
            return False
        return True

    def _head(self, part: Part) -> Head:
        return Head(part.frame, part.tile, part.first, part.count, part.bad_count, senders_text(part.workers), None)

    def _remember(self, head: Head, part: Part) -> None:
        """Note what was added."""
        where = head[:2]
        self._rows.setdefault(where, []).append(head)
        grow = partial(add_sums, data=part.sums, tile=self.tiles[part.tile])
        self._cache.grow((self._path.stem, *where), grow, len(part.sums))

    def _fold(self, frame: int, tile: int) -> None:
        """Make one row of a tile's rows where they are many: of all of them once they are one run, or of those of one worker.
        What was merged is in the film whether this succeeds or not."""
        rows = self._rows[frame, tile]
        if len(rows) < FOLD_AT:
            return
        try:
            if self.keeps_apart and len(rows) < MOST_APART:
                for worker in {head.workers for head in rows}:
                    own = [head for head in rows if head.workers == worker]
                    if len(own) >= FOLD_AT:
                        self._fold_to_one(own)
            elif self.keeps_apart or len(self._cover(frame, tile).ranges) == 1:
                self._fold_to_one(rows)
        except (FilmWaits, FilmLost) as error:
            self._in_doubt = True
            log.warning("a tile's rows stay apart: %s", error)

    def _fold_to_one(self, heads: list[Head]) -> None:
        assert self._file is not None
        where = frame, tile = heads[0][:2]
        is_whole_tile = len(heads) == len(self._rows[where])
        sums = self._cache.get((self._path.stem, frame, tile)) if is_whole_tile else None
        if sums is None:
            rows = self._file.sums(frame, tile) if is_whole_tile else self._file.sums_of(heads)
            sums = added_up(rows, self.tiles[tile])
        runs = Coverage(span for head in heads for span in head_spans(head)).ranges
        ranges = json.dumps([[start, end - start] for start, end in runs]) if len(runs) > 1 else None
        workers = senders_text({worker for head in heads for worker in senders_of(head.workers)})
        total, bad = sum(head.count for head in heads), sum(head.bad for head in heads)
        made = Head(frame, tile, runs[0][0], total, bad, workers, ranges)
        if self._file.fold(heads, (*made[:5], pack_sums(sums), *made[5:]), is_whole_tile):
            self._rows[where] = [*(head for head in self._rows[where] if head not in heads), made]
        else:
            self._in_doubt = True
