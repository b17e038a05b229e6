"""Tests that noise estimates take at most their fraction of the engine's processor time."""

from __future__ import annotations

import pytest

from service.scheduling.jobs.noise_budget import AT_ONCE_S, SHARE, NoiseBudget
from tests.service.scheduling.fake_clock import FakeClock


def test_saved_budget_is_used_then_fraction_of_time() -> None:
    clock = FakeClock()
    of = NoiseBudget(clock)
    clock.now += 1000.0  # idle time saves up no more than at the beginning

    def take(look_s: float) -> int:
        taken = 0
        while of.has_time():
            with of.charged():
                clock.now += look_s
            taken += 1
        return taken

    assert take(0.01) == pytest.approx(AT_ONCE_S / 0.01, rel=0.1)
    clock.now += 10.0
    assert take(0.01) == pytest.approx(10.0 * SHARE / 0.01, rel=0.2)
    clock.now += 0.001
    assert not of.has_time()
