"""Statistical assertions for random results, which use the results' own standard error or a chi-squared test."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.stats

from renderer.film import COLOR, COLOR_HALF, SAMPLES, SAMPLES_HALF, Sums

ALPHA = 0.01  # probability that any test of a family fails by chance (as in Mitsuba's chi2.py)


def sidak(alpha: float, tests: int) -> float:
    """Returns the significance level of one test such that a family of `tests` tests fails by chance with probability alpha."""
    return 1 - (1 - alpha) ** (1 / tests)


def limit(tests: int) -> float:
    """Returns by how many standard errors a mean may deviate in a family of `tests` tests: 3 for one test, more for several."""
    return float(scipy.stats.norm.isf(sidak(2 * scipy.stats.norm.sf(3.0), tests) / 2))


def mean_and_error(sums: Sums, film_exponent: int = 24) -> tuple[float, float]:
    """Returns the mean over all pixels and channels, and its standard error estimated from the film's two halves."""
    n, half = sums[SAMPLES].astype(float), sums[SAMPLES_HALF].astype(float)
    scale = 2.0**-film_exponent
    color = sums[COLOR].mean(0) * scale
    color_half = sums[COLOR_HALF].mean(0) * scale
    difference = color_half / half - (color - color_half) / (n - half)
    error = difference * np.sqrt(half * (n - half)) / n
    return float((color / n).mean()), float(np.sqrt((error**2).sum()) / error.size)


def assert_mean(sums: Sums, expected: float, slack: float = 1e-5, most_error: float = 0.01, tests: int = 1) -> None:
    """Asserts that the film's mean differs from `expected` by at most limit(tests) standard errors: 3 for one test.

    slack: allowed relative rounding error. most_error: largest relative standard error, above which the test would prove nothing.
    tests: number of such comparisons in the family.
    """
    mean, error = mean_and_error(sums)
    assert error <= most_error * expected, f"too noisy to judge: {error / expected:.2%}"
    allowed = limit(tests) * error + slack * expected
    assert abs(mean - expected) <= allowed, f"{mean:.6f} +- {error:.6f} where {expected:.6f} belongs"


def chi_squared(counts: np.ndarray, expected: np.ndarray, tests: int, name: str = "") -> None:
    """Asserts agreement by Pearson's chi-squared test, at level 0.01 with Sidak's correction for `tests` tests.

    Bins with fewer than five expected samples are pooled. Fails if a sample is in a bin where none is expected.
    """
    counts, expected = counts.ravel().astype(float), expected.ravel().astype(float)
    assert not counts[expected < 1e-6 * expected.max()].sum() > 1e-4 * counts.sum(), f"{name}: samples where the density is zero"
    order = np.argsort(expected)
    counts, expected = counts[order], expected[order]
    pooled = int(np.searchsorted(expected, 5.0))
    while 0 < pooled < len(expected) and expected[:pooled].sum() < 5.0:
        pooled += 1
    if pooled:
        counts = np.append(counts[pooled:], counts[:pooled].sum())
        expected = np.append(expected[pooled:], expected[:pooled].sum())
    statistic = ((counts - expected) ** 2 / expected).sum()
    p = scipy.stats.chi2.sf(statistic, len(counts) - 1)
    assert p > sidak(ALPHA, tests), f"{name}: chi-squared {statistic:.0f} over {len(counts)} bins, p = {p:.2g}"


def assert_uniform(counts: np.ndarray, tests: int = 1, name: str = "") -> None:
    """Asserts by chi-squared that the samples are uniform over the bins."""
    chi_squared(counts, np.full(counts.size, counts.sum() / counts.size), tests, name)


def direction_test(
    directions: np.ndarray,
    density: Callable[[np.ndarray], np.ndarray],
    tests: int,
    bins: tuple[int, int] = (32, 48),
    fine: int = 8,
    name: str = "",
) -> None:
    """Asserts that sampled directions (n, 3), NaN for rejected samples, follow the given density per steradian.

    Bins are equal in z and in azimuth; the density is integrated over each with fine x fine midpoints. The density must integrate
    to the fraction of accepted samples; rejected samples have a bin of their own.
    """
    rows, columns = bins
    refused = np.isnan(directions[:, 0])
    kept = directions[~refused].astype(float)
    row = np.clip(((kept[:, 2] + 1) / 2 * rows).astype(int), 0, rows - 1)
    column = np.minimum((np.arctan2(kept[:, 1], kept[:, 0]) / (2 * np.pi) % 1 * columns).astype(int), columns - 1)
    counts = np.zeros(bins)
    np.add.at(counts, (row, column), 1)
    z = (np.arange(rows * fine) + 0.5) / (rows * fine) * 2 - 1
    phi = (np.arange(columns * fine) + 0.5) / (columns * fine) * 2 * np.pi
    r = np.sqrt(1 - z**2)
    grid = np.stack([r[:, None] * np.cos(phi), r[:, None] * np.sin(phi), np.broadcast_to(z[:, None], (len(z), len(phi)))], -1)
    values = density(grid.reshape(-1, 3).astype(np.float32)).astype(float).reshape(rows, fine, columns, fine)
    assert (values >= 0).all(), f"{name}: a density below zero"
    mass = values.mean((1, 3)) * 4 * np.pi / (rows * columns)
    assert mass.sum() < 1.01, f"{name}: the density integrates to {mass.sum():.4f}"
    assert refused.any() or mass.sum() > 0.99, f"{name}: the density integrates to {mass.sum():.4f} and no sample is refused"
    rest = max(1 - mass.sum(), 0.0) if refused.any() else 0.0
    scaled = np.append(mass.ravel(), rest) / (mass.sum() + rest)
    chi_squared(np.append(counts.ravel(), refused.sum()), scaled * len(directions), tests, name)
