"""Tests of the idle time of slots that `bench dataset` finds in spans."""

from __future__ import annotations

import pytest

from tests.benchmarks.bench_dataset import gaps
from tests.rayfarm.otlp_receiver import Span

SECOND = 1_000_000_000


def span(name: str, begun: float, ended: float, id: str = "", parent: str = "job") -> Span:
    return Span("worker", "attic", name, "t", id or f"{name}{begun}", parent, int(begun * SECOND), int(ended * SECOND), None)


def test_time_between_and_after_the_tasks_of_a_slot_counts() -> None:
    spans = [
        span("batch", 2.0, 5.0),  # of the first slot, which was free later
        span("prepare frames", 0.0, 2.0),
        span("batch", 1.0, 4.0, id="outer"),
        span("open scene", 1.0, 1.5, parent="outer"),
        span("film", 4.0, 9.0),  # of the service
        span("batch", 6.0, 8.0),
    ]
    (first, length), (second, _) = gaps(spans, 2)
    assert length == pytest.approx(8.0)
    assert [(gap.begun, gap.ended, gap.after) for gap in first] == [(5.0, 6.0, "batch")]
    assert [(gap.begun, gap.ended, gap.after) for gap in second] == [(0.0, 1.0, "start"), (4.0, 8.0, "batch")]
    with pytest.raises(SystemExit, match="no span arrived"):
        gaps([], 2)
