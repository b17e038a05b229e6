"""Tests of the expected rendering times of batches, estimated from measured ones."""

from __future__ import annotations

import pytest

from service.scheduling.jobs.costs import LEAST_COST, MOST_FASTER, Costs

TILES = {0: 1.0, 1: 4.0, 2: 0.5, 3: 2.0, 4: 1.0, 5: 8.0, 6: 1.5, 7: 1.0}  # seconds per sample of each tile


def measured_over_expected(costs: Costs, pace: float, rounds: int = 1) -> list[float]:
    """Records one batch per tile and round. Returns the ratio of measured to expected time of each batch.

    pace: factor by which the machine is slower than the costs in TILES.
    """
    ratios = []
    for _ in range(rounds):
        for tile, cost in TILES.items():
            ratios.append(pace * cost / (costs.expected_cost(tile) or pace * cost))
            costs.record(tile, pace * cost, 1)
    return ratios


def test_batch_duration_is_stable_on_busier_machine() -> None:
    costs = Costs()
    measured_over_expected(costs, 1.0)
    assert measured_over_expected(costs, 1.0) == pytest.approx([1.0] * len(TILES))
    ratios = measured_over_expected(costs, 3.0)  # each tile once; from here on three times as slow
    assert ratios[0] == pytest.approx(3.0)
    assert max(ratios[4:]) < 1.4, "most tiles were last rendered at the old pace"
    measured_over_expected(costs, 3.0, rounds=10)
    assert measured_over_expected(costs, 3.0) == pytest.approx([1.0] * len(TILES), rel=0.1)


def test_batches_grow_slowly_on_idler_machine() -> None:
    costs = Costs()
    measured_over_expected(costs, 3.0, rounds=2)
    ratios = measured_over_expected(costs, 1.0)
    assert min(ratios) >= 1 / 3 - 1e-9
    assert max(costs.expected_cost(tile) / (3.0 * cost) for tile, cost in TILES.items()) <= 1.0
    assert all(costs.expected_cost(tile) >= cost / MOST_FASTER for tile, cost in TILES.items()), (
        "a batch is at most so much too long"
    )


def test_slow_first_batches_are_corrected() -> None:
    costs = Costs()
    for tile, cost in TILES.items():
        costs.record(tile, 5.0 * cost, 1)
    ratios = measured_over_expected(costs, 1.0)
    assert all(ratio == pytest.approx(1 / 5) for ratio in ratios)
    assert measured_over_expected(costs, 1.0) == pytest.approx([1.0] * len(TILES))


def test_costs_are_positive() -> None:
    costs = Costs()
    assert not costs.record(0, 0.0, 1) and costs.expected_cost(0) == 0.0
    assert costs.record(0, 1.0, 1)
    assert costs.record(1, 0.0, 1) and costs.expected_cost(1) == pytest.approx(1.0 / LEAST_COST)


def test_future_cost_leaves_out_the_overhead_of_short_batches() -> None:
    """First batches of one sample take mostly overhead. Once a tile has had a longer one, all tiles are corrected."""
    costs = Costs()
    overhead_s = 0.02
    cost = [1e-5 * (1 + tile % 5) for tile in range(50)]
    for tile in range(50):
        costs.record(tile, overhead_s + 1000 * cost[tile], 1000)
    assert costs.future_cost(0) > 2 * cost[0]
    for tile in range(10):
        costs.record(tile, overhead_s + 7000 * cost[tile], 7000)
    for tile in range(50):
        assert costs.future_cost(tile) == pytest.approx(cost[tile], rel=0.25)
    assert costs.future_cost(50) == costs.average, "a tile without a batch"
