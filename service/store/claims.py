"""Which of the parts that arrive together a film takes: each sample once.

A part that overlaps what is there is dropped: it, or a part of it, came twice. But sums that were added up on their way cover
several batches, and one of these may have arrived alone before, because a second worker tried a straggler too. If the rows that
overlap lie completely within the new part, the part replaces them: it has the same samples and more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from service.store.coverage import Coverage
from service.store.film_file import Head
from service.store.film_version import spans
from service.store.parts import Part

__all__ = ["Claims"]

_Where = tuple[int, int]  # frame, tile


class Claims:
    """Of one merge. coverage: of the tiles that change, as it will be. replaced: rows in whose place a part comes."""

    def __init__(
        self,
        parts: Sequence[Part],
        fit: Sequence[bool],
        known: Callable[[int, int], Coverage],
        rows: Callable[[int, int], Sequence[Head]] | None,
    ) -> None:
        """fit: which of them make sense. known: what is in of a tile; a copy. rows: a tile's, where they may be replaced."""
        self.coverage: dict[_Where, Coverage] = {}
        self.replaced: list[Head] = []
        self._known = known
        self._rows = rows
        self._new: dict[_Where, list[Part]] = {}
        # The largest first: what is in another is the one that came twice.
        taken = {i for i in sorted(range(len(parts)), key=lambda i: -parts[i].count) if fit[i] and self._claim(parts[i])}
        self.taken = [i in taken for i in range(len(parts))]  # of each part, whether it is

    def _claim(self, part: Part) -> bool:
        where = part.frame, part.tile
        coverage = self.coverage.get(where) or self._known(*where)
        if coverage.overlaps(part.first, part.count):
            within = self._within(part)
            if not within:
                return False
            coverage = coverage.without(part.first, part.count)
            self.replaced += within
        coverage.add(part.first, part.count)
        self.coverage[where] = coverage
        self._new.setdefault(where, []).append(part)
        return True

    def _within(self, part: Part) -> list[Head]:
        """The rows that a part has the samples of, and more; none where it has but some of those of a row, or no more."""
        where, end = (part.frame, part.tile), part.first + part.count
        if self._rows is None or any(_overlap(part, [(new.first, new.count)]) for new in self._new.get(where, ())):
            return []
        found = [head for head in self._rows(*where) if _overlap(part, spans(head.first, head.count, head.ranges))]
        inside = all(
            part.first <= first and first + count <= end
            for head in found
            for first, count in spans(head.first, head.count, head.ranges)
        )
        return found if inside and sum(head.count for head in found) < part.count else []


def _overlap(part: Part, others: list[tuple[int, int]]) -> bool:
    return any(first < part.first + part.count and part.first < first + count for first, count in others)
