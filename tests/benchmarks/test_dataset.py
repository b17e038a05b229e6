"""Tests of the idle time of slots that `bench dataset` finds in spans."""

from __future__ import annotations

import pytest

from tests.benchmarks.dataset.slots import gaps_by_cause, slot_times, worked
from tests.rayfarm.otlp_receiver import Span

SECOND = 1_000_000_000


def span(name: str, slot: int, begun: float, ended: float) -> Span:
    times = int(begun * SECOND), int(ended * SECOND)
    return Span("worker", "attic", name, "t", f"{name}{begun}", "job", *times, None, attributes={"rayfarm.slot": slot})


def test_only_rendering_and_preparing_are_work() -> None:
    spans = [
        span("trace paths", 0, 2.0, 5.0),
        span("prepare frames", 0, 0.0, 2.0),
        span("pack sums", 0, 4.5, 5.2),  # counts only while paths are traced
        span("send sums", 0, 5.2, 5.5),
        span("trace paths", 1, 1.0, 4.0),
        span("film", 0, 4.0, 9.0),  # of the service
        span("trace paths", 0, 6.0, 8.0),
    ]
    first, second = slot_times(worked(spans), 2)
    assert (first.length, first.rendering, first.preparing, first.idle) == pytest.approx((8.0, 5.0, 2.0, 1.0))
    assert [(gap.begun, gap.ended, gap.after) for gap in first.gaps] == [(5.0, 6.0, "trace paths")]
    assert [(gap.begun, gap.ended, gap.after) for gap in second.gaps] == [(0.0, 1.0, "start"), (4.0, 8.0, "trace paths")]
    last_sums, other_sums = (0, 5 * SECOND + 1), (1, int(2.5 * SECOND))
    found = gaps_by_cause([first, second], [last_sums, other_sums])
    assert found == {"at the start or at the end": [1.0, 4.0], "after a message": [1.0]}
    assert list(gaps_by_cause([first], [])) == ["between two batches of a message"]
    with pytest.raises(SystemExit, match="no span arrived"):
        slot_times([], 2)
