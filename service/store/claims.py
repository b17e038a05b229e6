"""Selects which contributions of a merge a film accepts, so that each sample is stored exactly once.

A contribution that overlaps stored samples is dropped, because all or some of it was stored before. There is one exception: a
contribution whose sums were added up in transit covers several batches, of which one may already be stored, because a second
worker has rendered a duplicate of it. If all overlapping rows lie within the new contribution, it replaces them: it contains
the same samples and more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from service.store.contributions import Contribution
from service.store.coverage import Coverage
from service.store.film_file import RowHead
from service.store.film_version import sample_ranges

__all__ = ["Claims"]

_FrameTile = tuple[int, int]  # frame, tile


class Claims:
    """The decision which contributions of a merge a film accepts.

    coverage: sample numbers that each changed tile has after the merge. replaced: stored rows that an accepted contribution
    replaces. taken: for each contribution, whether it is accepted.
    """

    def __init__(
        self,
        contributions: Sequence[Contribution],
        is_valid: Sequence[bool],
        coverage_of: Callable[[int, int], Coverage],
        rows: Callable[[int, int], Sequence[RowHead]] | None,
    ) -> None:
        """Decides which contributions to accept.

        is_valid: for each contribution, whether it may be accepted. coverage_of: returns a copy of the stored sample numbers of
        a tile, by frame key and tile index. rows: returns the heads of the stored rows of such a tile; None: no row may be
        replaced.
        """
        self.coverage: dict[_FrameTile, Coverage] = {}
        self.replaced: list[RowHead] = []
        self._known = coverage_of
        self._rows = rows
        self._new: dict[_FrameTile, list[Contribution]] = {}
        # The largest first: a part that lies within a larger one is the duplicate.
        taken = {
            i
            for i in sorted(range(len(contributions)), key=lambda i: -contributions[i].count)
            if is_valid[i] and self._claim(contributions[i])
        }
        self.taken = [i in taken for i in range(len(contributions))]  # for each part, whether it is accepted

    def _claim(self, contribution: Contribution) -> bool:
        where = contribution.frame, contribution.tile
        coverage = self.coverage.get(where) or self._known(*where)
        if coverage.overlaps(contribution.first, contribution.count):
            within = self._replaced_rows(contribution)
            if not within:
                return False
            coverage = coverage.without_range(contribution.first, contribution.count)
            self.replaced += within
        coverage.add(contribution.first, contribution.count)
        self.coverage[where] = coverage
        self._new.setdefault(where, []).append(contribution)
        return True

    def _replaced_rows(self, contribution: Contribution) -> list[RowHead]:
        """Returns the heads of the stored rows that a contribution replaces.

        Empty unless the contribution contains all samples of these rows, and more.
        """
        where, end = (contribution.frame, contribution.tile), contribution.first + contribution.count
        if self._rows is None or any(_overlap(contribution, [(new.first, new.count)]) for new in self._new.get(where, ())):
            return []
        found = [
            head for head in self._rows(*where) if _overlap(contribution, sample_ranges(head.first, head.count, head.ranges))
        ]
        inside = all(
            contribution.first <= first and first + count <= end
            for head in found
            for first, count in sample_ranges(head.first, head.count, head.ranges)
        )
        return found if inside and sum(head.count for head in found) < contribution.count else []


def _overlap(contribution: Contribution, others: list[tuple[int, int]]) -> bool:
    return any(first < contribution.first + contribution.count and contribution.first < first + count for first, count in others)
