"""Tests of pacing: the duration and number of batches follow the rate at which results are processed. The clock is simulated."""

from __future__ import annotations

import pytest

from service.scheduling.dispatching.pacing import (
    ASSUMED_BATCH_COST_S,
    MAX_BATCHES_OF_A_TILE,
    MAX_JOINT_BATCHES,
    RESULTS_TIME_SHARE,
    BatchSizing,
)
from tests.service.scheduling.fake_clock import FakeClock


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


def take_in(of: BatchSizing, clock: FakeClock, results: int, result_s: float, seconds: float = 1.0) -> None:
    with of.measuring():
        clock.now += results * result_s
    clock.now += max(seconds - results * result_s, 0.0)
    of.record_results(results)


def test_batch_duration_grows_with_slots_and_result_cost(clock: FakeClock) -> None:
    of = BatchSizing(0.5, 10.0, 1 << 20, clock=clock)
    assert (of.batch_s(100), of.batch_s(1000)) == (0.5, pytest.approx(1000 * ASSUMED_BATCH_COST_S / RESULTS_TIME_SHARE)), (
        "nothing is known"
    )
    for _ in range(5):
        take_in(of, clock, 200, 0.002)
    assert of.batch_s(10) == of.batch_s(100) == 0.5
    assert of.batch_s(1000) == pytest.approx(1000 * 0.002 / RESULTS_TIME_SHARE)
    assert of.batch_s(100_000) == 10.0
    assert (of.window(100, 2), of.window(1000, 2), of.window(100_000, 2)) == (200, 1250, 110_000), "what is taken in a second"
    assert of.window(1000, 2, joint=True) == 1000 + 250 + 313, "and what is done without anybody knowing yet"
    assert of.window(32, 2, joint=True) == of.window(32, 2), "so few add up nothing"
    take_in(of, clock, 2, 0.4)
    assert of.batch_s(1000) == pytest.approx(1000 * 0.002 / RESULTS_TIME_SHARE), "two results say nothing of what many cost"


def test_batch_duration_grows_with_spent_time_without_live_view(clock: FakeClock) -> None:
    pressed = False
    of = BatchSizing(0.5, 10.0, 1 << 20, lambda: pressed, clock)
    assert of.batch_s(8, spent_s=4.0) == 0.5
    assert of.window(2, 2) == 4
    assert of.batch_s(8, spent_s=16.0) == 1.0
    assert of.batch_s(8, spent_s=1e6) == 1.5
    assert of.window(4, 2) == 4 + 3, "what waits is less where batches are longer"
    pressed = True
    assert of.batch_s(8, spent_s=1e6) == 0.5
    assert of.window(2, 2) == 4


def test_batch_duration_is_constant_for_few_slots(clock: FakeClock) -> None:
    of = BatchSizing(0.5, 10.0, 1 << 20, clock=clock)
    assert [of.batch_s(slots, spent_s=1e6) for slots in (1, 2, 4, 6, 100)] == [0.5, 0.5, 1.0, 1.5, 1.5]


def test_message_duration_of_a_shot_grows_with_few_slots_too(clock: FakeClock) -> None:
    pressed = False
    of = BatchSizing(0.5, 10.0, 1 << 20, lambda: pressed, clock)
    assert [of.message_s(of.batch_s(2, spent_s), spent_s) for spent_s in (0.0, 2.0, 4.0, 1e6)] == [0.25, 0.5, 1.0, 1.5]
    assert of.window(4, 2) == 4 + 3, "what waits is less where messages are longer"
    assert of.message_s(of.batch_s(2, spent_s=3.0), 3.0, is_recallable=True) == 3.0
    assert of.message_s(of.batch_s(2, spent_s=1e6), 1e6, is_recallable=True) == 6.0
    assert of.window(4, 2) == 4 + 3, "these are withdrawn when other work waits"
    pressed = True
    assert of.message_s(of.batch_s(2, spent_s=1e6), 1e6, is_recallable=True) == 0.25


def test_backlog_lengthens_batches_and_stops_dispatch(clock: FakeClock) -> None:
    of = BatchSizing(0.5, 10.0, 1 << 20, clock=clock)
    take_in(of, clock, 50, 0.001)
    of.record_unread(512, 1024.0)
    assert of.scaled_room(100) == 50
    take_in(of, clock, 50, 0.001)
    longer = of.batch_s(10)
    assert longer > 0.5
    of.record_unread(4096, 1024.0)
    assert of.scaled_room(100) == 0
    assert of.scaled_room(-5) == -5, "what is out too much stays so"
    of.record_unread(0, 1024.0)
    for _ in range(20):
        take_in(of, clock, 50, 0.001)
    assert (of.scaled_room(100), of.batch_s(10)) == (100, 0.5)


def test_few_slots_have_single_batches_per_tile(clock: FakeClock) -> None:
    of = BatchSizing(0.5, 10.0, 1 << 20, clock=clock)
    assert (of.batches_of_a_tile(2), of.gather_s) == (1, 0.0)
    take_in(of, clock, 8, 0.001)
    assert of.gather_s == 0.0
    take_in(of, clock, 400, 0.001)
    assert 0.0 < of.gather_s < 0.5
    assert of.batches_of_a_tile(100_000) == MAX_BATCHES_OF_A_TILE
    assert [of.batches_of_a_tile(slots, joint=True) for slots in (2, 32, 33, 100, 100_000)] == [1, 1, 2, 6, MAX_JOINT_BATCHES]
    assert (of.hold_s(0.1), of.hold_s(4.0)) == (1.0, 4.0)


def test_combined_results_lower_batch_cost(clock: FakeClock) -> None:
    alone, together = BatchSizing(0.5, 10.0, 1 << 20, clock=clock), BatchSizing(0.5, 10.0, 1 << 20, clock=clock)
    for _ in range(5):
        take_in(alone, clock, 100, 0.004)
        with together.measuring():
            clock.now += 0.016
        clock.now += 1.0
        together.record_results(2, 32, 0.016)
    assert alone.batch_s(1000) == pytest.approx(1000 * 0.004 / RESULTS_TIME_SHARE)
    assert together.batch_s(1000) == pytest.approx(1000 * 0.0005 / RESULTS_TIME_SHARE), "also where few results a second come"


def test_burst_processed_at_once_is_no_backlog(clock: FakeClock) -> None:
    of = BatchSizing(0.5, 10.0, 1 << 20, clock=clock)
    for seconds, longer in ((0.05, False), (5.0, True)):
        of.record_unread(60, 1024.0)
        clock.now += 1.0
        of.record_results(10, 160, seconds)
        assert (of.batch_s(1) > 0.5) == longer


def test_batch_duration_is_at_least_transit_time(clock: FakeClock) -> None:
    """Checks that the target duration of batches is at least the transit time of their results.

    Otherwise slots with slow connections would spend most of their time on sending.
    """
    of = BatchSizing(0.5, 10.0, 1 << 20, clock=clock)
    for seconds in (30.0, 30.0, 0.0, 0.0, 0.1, 0.0, 30.0, 0.0, 0.0):
        of.record_transit(seconds)
        assert of.batch_s(2) == 0.5, "a few have waited for a kernel"
    for seconds, longer in ((4.0, 4.0), (71.0, 10.0), (0.0, 0.5)):
        for _ in range(16):
            of.record_transit(seconds)
        assert of.batch_s(2) == longer
