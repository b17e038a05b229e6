from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.store.coverage import Coverage

Ranges = st.lists(st.tuples(st.integers(0, 60), st.integers(1, 12)), max_size=30)


@given(Ranges, st.integers(0, 70), st.integers(0, 70))
def test_coverage_equals_set_of_samples(ranges: list[tuple[int, int]], start: int, end: int) -> None:
    coverage, model = Coverage(), set[int]()
    for first, count in ranges:
        samples = set(range(first, first + count))
        assert coverage.overlaps(first, count) == bool(model & samples)
        if model & samples:
            with pytest.raises(ValueError, match="covered already"):
                coverage.add(first, count)
        else:
            coverage.add(first, count)
            model |= samples
    assert coverage.total == len(model)
    assert coverage.end == max(model, default=-1) + 1
    assert coverage.prefix == next(i for i in range(200) if i not in model)
    assert {i for a, b in coverage.gaps(start, end) for i in range(a, b)} == set(range(start, end)) - model
    assert all(b1 < a2 for (_, b1), (a2, _) in zip(coverage.ranges, coverage.ranges[1:], strict=False)), (
        "ranges that touch are joined"
    )


def test_empty_range_is_rejected() -> None:
    with pytest.raises(ValueError, match="invalid range"):
        Coverage().add(3, 0)
