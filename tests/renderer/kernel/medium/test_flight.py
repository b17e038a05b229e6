"""Tests of free flights in media: the expected throughput follows Beer's law, and throughput never grows."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.medium.flight import free_flight
from tests.renderer.judge import limit

N = 100_000
THROUGHPUT = np.array((0.9, 0.5, 0.1))


@entry
def _fly(sigma_t, sigma_s, throughput, reach, u, carried, ends):
    t = sigma_t[0], sigma_t[1], sigma_t[2]
    s = sigma_s[0], sigma_s[1], sigma_s[2]
    for i in range(len(u)):
        flight = free_flight(t, s, (throughput[0], throughput[1], throughput[2]), reach, (u[i, 0], u[i, 1]))
        ends[i, 0] = np.float32(1.0) if flight.scatters else np.float32(0.0)
        ends[i, 1] = flight.distance
        for c in range(3):
            carried[i, c] = flight.throughput[c]


def flown(sigma_t: np.ndarray, sigma_s: np.ndarray, reach: float, throughput: np.ndarray = THROUGHPUT) -> tuple[np.ndarray, ...]:
    """Samples N free flights up to the distance `reach`; returns three arrays of N values.

    These are the throughputs (N, 3), whether the flight ends in scattering, and its distance.
    """
    carried, ends = np.empty((N, 3), np.float32), np.empty((N, 2), np.float32)
    u = np.random.default_rng(2).random((N, 2), np.float32)
    told = (np.array(each, np.float32) for each in (sigma_t, sigma_s, throughput))
    _fly(*told, np.float32(reach), u, carried, ends)
    return carried.astype(float), ends[:, 0] > 0, ends[:, 1].astype(float)


@pytest.mark.parametrize("reach", [0.3, 2.0, np.inf])
@pytest.mark.parametrize("sigma_t", [(1.0, 1.0, 1.0), (0.5, 2.0, 9.0), (0.0, 0.2, 4.0)])
def test_flight_and_scattering_probabilities(sigma_t: tuple[float, ...], reach: float) -> None:
    sigma = np.array(sigma_t)
    carried, scatters, distance = flown(sigma, 0.8 * sigma, reach)
    passing = np.array([1.0 if s == 0 else np.exp(-s * reach) for s in sigma_t])
    for which, expected in ((scatters, 0.8 * (1 - passing)), (~scatters, passing)):
        found = np.where(which[:, None], carried, 0)
        error = found.std(axis=0) / np.sqrt(N)
        assert (np.abs(found.mean(axis=0) - THROUGHPUT * expected) <= limit(54) * error + 1e-5).all()
    assert (carried.sum(axis=1) <= THROUGHPUT.sum() * (1 + 1e-5)).all()
    assert (distance[scatters] < reach).all()
    assert np.isfinite(carried).all()


def test_pure_absorption_is_deterministic() -> None:
    sigma = np.array((0.1, 1.0, 30.0))
    carried, scatters, distance = flown(sigma, np.zeros(3), 1.5)
    assert not scatters.any()
    assert (distance == 1.5).all()
    expected = np.broadcast_to(THROUGHPUT * np.exp(-1.5 * sigma), (N, 3))
    np.testing.assert_allclose(carried, expected, rtol=1e-5, atol=1e-20)
    assert (flown(sigma, np.zeros(3), np.inf)[0] == 0).all()


def test_empty_medium_keeps_the_throughput() -> None:
    for reach in (1.0, np.inf):
        carried, scatters, _ = flown(np.zeros(3), np.zeros(3), reach)
        assert not scatters.any()
        assert (carried == THROUGHPUT.astype(np.float32)).all()


def test_zero_throughput_stays_finite() -> None:
    assert (flown(np.ones(3), np.ones(3), 1.0, np.zeros(3))[0] == 0).all()
