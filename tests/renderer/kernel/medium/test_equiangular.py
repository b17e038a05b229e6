"""Tests of equiangular distance sampling: samples against the pdf (chi-squared), unbiased throughput, limiting cases."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chisquare

from renderer.jit import entry
from renderer.kernel.medium.equiangular import (
    choose_pivot,
    equiangular_share,
    equiangular_span,
    pdf_equiangular,
    sample_equiangular,
)
from renderer.kernel.medium.flight import free_flight, free_flight_by_lamp
from tests.renderer.judge import limit

N = 200_000
BINS = 64
THROUGHPUT = np.array((0.9, 0.5, 0.1))
ORIGIN, DIRECTION = np.array((0.3, -0.2, 0.5)), np.array((0.6, 0.0, -0.8))


@entry
def _sample(lamp, reach, sigma, throughput, u, out):
    o, d = (np.float32(0.3), np.float32(-0.2), np.float32(0.5)), (np.float32(0.6), np.float32(0.0), np.float32(-0.8))
    s = sigma[0], sigma[1], sigma[2]
    t = s[0] + sigma[3], s[1] + sigma[4], s[2] + sigma[5]
    carried = throughput[0], throughput[1], throughput[2]
    span = equiangular_span(o, d, (lamp[0], lamp[1], lamp[2]), lamp[3], reach)
    share = equiangular_share(span, t)
    for i in range(len(u)):
        numbers = u[i, 0], u[i, 1], u[i, 2], u[i, 3]
        flight = free_flight_by_lamp(t, s, carried, reach, numbers, span, share)
        alone = free_flight_by_lamp(t, s, carried, reach, numbers, span, np.float32(0.0))
        plain = free_flight(t, s, carried, reach, (numbers[0], numbers[1]))
        out[i, 0] = sample_equiangular(span, u[i, 0])
        out[i, 1] = pdf_equiangular(span, out[i, 0])
        out[i, 2], out[i, 3] = np.float32(flight.scatters), flight.distance
        out[i, 4], out[i, 5], out[i, 6] = flight.throughput
        out[i, 7] = np.float32(
            alone.scatters == plain.scatters and alone.distance == plain.distance and alone.throughput == plain.throughput
        )
        out[i, 8] = share


def sampled(
    beside: float, ahead: float, reach: float, radius: float = 0.0, sigma: tuple[float, ...] = (0.4, 0.8, 1.6, 0.1, 0.2, 0.4)
) -> np.ndarray:
    """Returns N rows of `_sample` for a lamp `ahead` along the ray and `beside` it. sigma: sigma_s, then sigma_a, rgb."""
    lamp = np.array((*(ORIGIN + ahead * DIRECTION + beside * np.array((0.8, 0.0, 0.6))), radius), np.float32)
    out = np.empty((N, 9), np.float32)
    u = np.random.default_rng(5).random((N, 4), np.float32)
    _sample(lamp, np.float32(reach), np.array(sigma, np.float32), THROUGHPUT.astype(np.float32), u, out)
    return out.astype(float)


def cdf(t: np.ndarray, away: float, ahead: float, reach: float) -> np.ndarray:
    """Returns the closed form of the distances' cdf (Kulla & Fajardo, equations 5 to 7)."""
    end = np.pi / 2 if np.isinf(reach) else np.arctan((reach - ahead) / away)
    begin = np.arctan(-ahead / away)
    return np.asarray((np.arctan((t - ahead) / away) - begin) / (end - begin))


LAMPS = {
    "beside": (1.0, 2.0, 5.0, 0.0),
    "near": (0.01, 2.0, 5.0, 0.0),
    "behind": (0.5, -1.0, 5.0, 0.0),
    "beyond the end": (0.5, 9.0, 5.0, 0.0),
    "far off": (300.0, 2.0, 5.0, 0.0),
    "in a ray without end": (0.5, 2.0, np.inf, 0.0),
    "a sphere on the ray": (0.0, 2.0, 5.0, 0.3),
}


@pytest.mark.parametrize("name", LAMPS)
def test_distances_follow_their_pdf(name: str) -> None:
    """Distances are distributed by the closed form (chi-squared), and the pdf is its derivative at each of them."""
    beside, ahead, reach, radius = LAMPS[name]
    away = max(beside, radius)
    out = sampled(beside, ahead, reach, radius)
    counts = np.histogram(cdf(out[:, 0], away, ahead, reach), BINS, (0.0, 1.0))[0]
    assert counts.sum() >= N - 5  # rounding may put a few beyond the ends
    assert chisquare(counts, np.full(BINS, counts.sum() / BINS)).pvalue > 1e-4 / len(LAMPS)
    end = np.pi / 2 if np.isinf(reach) else np.arctan((reach - ahead) / away)
    density = away / (end - np.arctan(-ahead / away)) / (away**2 + (out[:, 0] - ahead) ** 2)
    np.testing.assert_allclose(out[:, 1], density, rtol=3e-3)


@pytest.mark.parametrize("name", LAMPS)
def test_the_mixture_carries_what_exponential_flights_carry(name: str) -> None:
    """The mean throughput, scattered and at the end, is that of Beer's law; without a share the flight is the plain one."""
    beside, ahead, reach, radius = LAMPS[name]
    out = sampled(beside, ahead, reach, radius)
    scatters, carried = out[:, 2] > 0, out[:, 4:7]
    sigma_s, sigma_t = np.array((0.4, 0.8, 1.6)), np.array((0.5, 1.0, 2.0))
    passing = np.exp(-sigma_t * reach)
    assert np.isfinite(carried).all()
    assert (out[scatters, 3] < reach).all()
    assert 0 <= out[0, 8] <= 0.5
    for which, expected in ((scatters, sigma_s / sigma_t * (1 - passing)), (~scatters, passing)):
        found = np.where(which[:, None], carried, 0)
        error = found.std(axis=0) / np.sqrt(N)
        assert (np.abs(found.mean(axis=0) - THROUGHPUT * expected) <= limit(6 * len(LAMPS)) * error + 1e-5).all()
    assert (carried.sum(axis=1) <= THROUGHPUT.sum() / (1 - out[0, 8]) * (1 + 1e-5)).all()
    assert (out[:, 7] == 1).all()


def test_light_from_a_lamp_has_less_variance() -> None:
    """Single scattering of a point lamp in thin fog: the mixture's variance is a small fraction of exponential sampling's."""
    thin = (0.02, 0.02, 0.02, 0.0, 0.0, 0.0)
    variance = []
    for sigma_far in (0.0, 1e6):  # a lamp so far that its share is 0
        out = sampled(0.1 + sigma_far, 2.0, 5.0, 0.0, thin)
        arriving = np.where(out[:, 2] > 0, out[:, 4] / (0.1**2 + (out[:, 3] - 2.0) ** 2), 0.0)
        variance.append(arriving.var())
        expected = 0.9 * 0.02 / 0.1 * (np.arctan(30.0) + np.arctan(20.0)) * np.exp(-0.02 * 2.0)
        assert arriving.mean() == pytest.approx(expected, rel=0.1)
    assert variance[0] < 0.02 * variance[1]


def test_no_light_no_share() -> None:
    """A lamp behind a thick medium gets next to no flights."""
    assert sampled(1.0, 2.0, 5.0, 0.0, (9.0, 9.0, 9.0, 0.0, 0.0, 0.0))[0, 8] < 1e-6


@entry
def _choose(pivots, u, out):
    for i in range(len(u)):
        center, radius = choose_pivot(pivots, u[i])
        out[i, 0], out[i, 1] = center[0], radius


def test_lamps_are_chosen_by_their_cdf() -> None:
    pivots = np.array(((1, 0, 0, 0.1, 0.5), (2, 0, 0, 0.2, 0.75), (3, 0, 0, 0.3, 1.0)), np.float32)
    out = np.empty((6, 2), np.float32)
    _choose(pivots, np.array((0.0, 0.49, 0.5, 0.74, 0.75, 0.999), np.float32), out)
    np.testing.assert_allclose(out[:, 0], (1, 1, 2, 2, 3, 3))
    np.testing.assert_allclose(out[:, 1], (0.1, 0.1, 0.2, 0.2, 0.3, 0.3), rtol=1e-6)
