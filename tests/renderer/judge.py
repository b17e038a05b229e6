"""How tests judge what is random: by its own standard error, and by chi-squared."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.stats

from renderer.film import COLOR, COLOR_EVEN, SAMPLES, SAMPLES_EVEN, Sums

ALPHA = 0.01


def mean_and_error(sums: Sums, film_exponent: int = 24) -> tuple[float, float]:
    """The mean over all pixels and channels, and its standard error from the film's two halves."""
    n, even = sums[SAMPLES].astype(float), sums[SAMPLES_EVEN].astype(float)
    scale = 2.0**-film_exponent
    color = sums[COLOR].mean(0) * scale
    color_even = sums[COLOR_EVEN].mean(0) * scale
    difference = color_even / even - (color - color_even) / (n - even)
    error = difference * np.sqrt(even * (n - even)) / n
    return float((color / n).mean()), float(np.sqrt((error**2).sum()) / error.size)


def assert_mean(sums: Sums, expected: float, slack: float = 1e-5, most_error: float = 0.01) -> None:
    """Within three standard errors of the expected mean. slack: relative rounding of the arithmetic or of the expectation.

    most_error: relative; a test with more noise would prove nothing.
    """
    mean, error = mean_and_error(sums)
    assert error <= most_error * expected, f"too noisy to judge: {error / expected:.2%}"
    assert abs(mean - expected) <= 3 * error + slack * expected, f"{mean:.6f} +- {error:.6f} where {expected:.6f} belongs"


def chi_squared(counts: np.ndarray, expected: np.ndarray, tests: int) -> None:
    """Pearson's test, bins pooled below five, alpha 0.01 with Sidak's correction for `tests` tests.

    Fails where a sample lands where none is expected.
    """
    counts, expected = counts.ravel().astype(float), expected.ravel().astype(float)
    assert not counts[expected < 1e-6 * expected.max()].sum() > 1e-4 * counts.sum(), "samples where the density is zero"
    order = np.argsort(expected)
    counts, expected = counts[order], expected[order]
    pooled = int(np.searchsorted(np.cumsum(expected), 5.0)) + 1
    observed = np.concatenate([[counts[:pooled].sum()], counts[pooled:]])
    hoped = np.concatenate([[expected[:pooled].sum()], expected[pooled:]])
    statistic = ((observed - hoped) ** 2 / hoped).sum()
    p = scipy.stats.chi2.sf(statistic, len(observed) - 1)
    assert p > 1 - (1 - ALPHA) ** (1 / tests), f"chi-squared: p = {p:.2g} over {len(observed)} bins"


def direction_test(
    directions: np.ndarray,
    density: Callable[[np.ndarray], np.ndarray],
    tests: int,
    bins: tuple[int, int] = (32, 48),
    fine: int = 8,
) -> None:
    """Directions (n, 3), NaN where a sample was refused, against the density per steradian that they claim.

    Bins are equal in z and in angle; each is integrated with fine x fine midpoints.
    """
    rows, columns = bins
    refused = np.isnan(directions[:, 0])
    kept = directions[~refused].astype(float)
    row = np.minimum(((kept[:, 2] + 1) / 2 * rows).astype(int), rows - 1)
    column = np.minimum((np.arctan2(kept[:, 1], kept[:, 0]) / (2 * np.pi) % 1 * columns).astype(int), columns - 1)
    counts = np.zeros(bins)
    np.add.at(counts, (row, column), 1)
    z = (np.arange(rows * fine) + 0.5) / (rows * fine) * 2 - 1
    phi = (np.arange(columns * fine) + 0.5) / (columns * fine) * 2 * np.pi
    r = np.sqrt(1 - z**2)
    grid = np.stack([r[:, None] * np.cos(phi), r[:, None] * np.sin(phi), np.broadcast_to(z[:, None], (len(z), len(phi)))], -1)
    values = density(grid.reshape(-1, 3).astype(np.float32)).astype(float).reshape(rows, fine, columns, fine)
    mass = values.mean((1, 3)) * 4 * np.pi / (rows * columns)
    assert mass.sum() < 1.01, f"the density integrates to {mass.sum():.4f}"
    rest = max(1 - mass.sum(), 0.0) if refused.any() else 0.0
    total = len(directions)
    scaled = np.append(mass.ravel(), rest) / (mass.sum() + rest)
    chi_squared(np.append(counts.ravel(), refused.sum()), scaled * total, tests)
