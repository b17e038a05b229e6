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
            costs.record(tile, pace * cost)
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
        costs.record(tile, 5.0 * cost)
    ratios = measured_over_expected(costs, 1.0)
    assert all(ratio == pytest.approx(1 / 5) for ratio in ratios)
    assert measured_over_expected(costs, 1.0) == pytest.approx([1.0] * len(TILES))


def test_costs_are_positive() -> None:
    costs = Costs()
    assert not costs.record(0, 0.0) and costs.expected_cost(0) == 0.0
    assert costs.record(0, 1.0)
    assert costs.record(1, 0.0) and costs.expected_cost(1) == pytest.approx(1.0 / LEAST_COST)
