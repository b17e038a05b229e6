"""Set of the sample numbers that a film contains of a tile, as sorted disjoint half-open ranges."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator

__all__ = ["Coverage"]


class Coverage:
    """A set of sample numbers. Adjacent ranges are joined, so equal sets have equal lists."""

    def __init__(self, ranges: Iterable[tuple[int, int]] = ()) -> None:
        """Creates the set. ranges: (first, count) pairs that do not overlap, in any order."""
        self.ranges: list[tuple[int, int]] = []
        for first, count in ranges:
            self.add(first, count)

    @property
    def total(self) -> int:
        """Number of covered samples."""
        return sum(end - start for start, end in self.ranges)

    @property
    def prefix(self) -> int:
        """Number of contiguous samples from sample 0; 0 if sample 0 is not covered."""
        return self.ranges[0][1] if self.ranges and self.ranges[0][0] == 0 else 0

    @property
    def end(self) -> int:
        """Highest covered sample number plus one; 0 if none is covered."""
        return self.ranges[-1][1] if self.ranges else 0

    def overlaps(self, first: int, count: int) -> bool:
        """Returns True if any of the samples first ... first + count - 1 is covered."""
        at = bisect_right(self.ranges, (first, 1 << 62))
        before = at > 0 and self.ranges[at - 1][1] > first
        return before or (at < len(self.ranges) and self.ranges[at][0] < first + count)

    def add(self, first: int, count: int) -> None:
        """Adds the samples first ... first + count - 1.

        Raises ValueError if the range is empty, negative, or overlaps a covered one.
        """
        if count < 1 or first < 0:
            raise ValueError(f"invalid range of samples: {count} from {first}")
        if self.overlaps(first, count):
            raise ValueError(f"samples {first} to {first + count - 1} are covered already")
        start, end = first, first + count
        at = bisect_right(self.ranges, (start, end))
        if at < len(self.ranges) and self.ranges[at][0] == end:
            end = self.ranges.pop(at)[1]
        if at > 0 and self.ranges[at - 1][1] == start:
            at -= 1
            start = self.ranges.pop(at)[0]
        self.ranges.insert(at, (start, end))

    def without_range(self, first: int, count: int) -> Coverage:
        """Returns a copy without the samples first ... first + count - 1."""
        kept = Coverage()
        for start, end in self.ranges:
            pieces = (start, min(end, first)), (max(start, first + count), end)
            kept.ranges += [(a, b) for a, b in pieces if a < b]
        return kept

    def gaps(self, start: int, end: int) -> Iterator[tuple[int, int]]:
        """Yields, in order, the half-open ranges within [start, end) that are not covered."""
        for covered_start, covered_end in self.ranges:
            if covered_end <= start:
                continue
            if covered_start >= end:
                break
            if covered_start > start:
                yield start, covered_start
            start = covered_end
        if start < end:
            yield start, end
