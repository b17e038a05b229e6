"""Statistical test that two renderers' pictures are equal, each given as batches of independent samples."""

from __future__ import annotations

import numpy as np
import scipy.stats

from tests.renderer.judge import ALPHA, sidak

__all__ = ["assert_same_picture"]

_MOST_UNLIKE = 0.0025  # share of pixels that may differ, as in Mitsuba's test_renders.py
_ROUNDING = 2e-4  # relative float32 error allowed in pixels without noise, whose variance is 0
_BLOCK = 8


def _p_values(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the p values of Welch's test that `a` and `b` have equal means. The first axis of both counts the batches."""
    mean_a, mean_b = a.mean(0), b.mean(0)
    variance_a, variance_b = a.var(0, ddof=1) / len(a), b.var(0, ddof=1) / len(b)
    variance = variance_a + variance_b
    rounding = (_ROUNDING * np.maximum(np.abs(mean_a), np.abs(mean_b))) ** 2
    freedom = variance**2 / np.maximum(variance_a**2 / (len(a) - 1) + variance_b**2 / (len(b) - 1), 1e-30)
    t = np.abs(mean_a - mean_b) / np.sqrt(np.maximum(variance + rounding, 1e-30))
    return 2 * scipy.stats.t.sf(t, np.maximum(freedom, min(len(a), len(b)) - 1))


def _blocks(batches: np.ndarray) -> np.ndarray:
    n, h, w, c = batches.shape
    return batches.reshape(n, h // _BLOCK, _BLOCK, w // _BLOCK, _BLOCK, c).mean((2, 4))


def assert_same_picture(ours: np.ndarray, theirs: np.ndarray, most_error: float = 0.005) -> str:
    """Asserts that batches (n, h, w, 3) of independent samples have the same mean; returns the figures as a line.

    Differences must be explained by noise (alpha 0.01, Sidak-corrected) in 99.75 % of pixels, in every block of 8 x 8 pixels, and
    in the mean of the picture: averages reveal what is too faint for single pixels.
    most_error: maximum relative standard error of the picture's mean; noisier pictures would prove nothing.
    """
    pixels = _p_values(ours, theirs)
    unlike = float((pixels < sidak(ALPHA, pixels.size)).any(-1).mean())
    blocks = _p_values(_blocks(ours), _blocks(theirs))
    whole_ours, whole_theirs = ours.mean((1, 2, 3)), theirs.mean((1, 2, 3))
    whole = float(_p_values(whole_ours, whole_theirs))
    a, b = float(whole_ours.mean()), float(whole_theirs.mean())
    error = float(np.hypot(whole_ours.std(ddof=1) / len(ours) ** 0.5, whole_theirs.std(ddof=1) / len(theirs) ** 0.5))
    figures = (
        f"means {a:.5f} and {b:.5f} ({a / b - 1:+.2%} +- {error / b:.2%}, p = {whole:.2g}); "
        f"{unlike:.2%} of pixels unlike; least p of a block {blocks.min():.2g} where {sidak(ALPHA, blocks.size):.2g} is allowed"
    )
    assert error <= most_error * b, f"too noisy to judge: {figures}"
    assert unlike <= _MOST_UNLIKE, figures
    assert blocks.min() >= sidak(ALPHA, blocks.size), figures
    assert whole >= ALPHA / 10, figures
    return figures
