"""Tests of the phase function: samples follow their stated density, and g is their mean cosine."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.medium.henyey_greenstein import pdf_henyey_greenstein, sample_henyey_greenstein
from tests.renderer.judge import direction_test, limit

GS = (0.0, 0.3, -0.6, 0.8)
N = 200_000


@entry
def _sample(g, u, found):
    for i in range(len(u)):
        x, y, z = sample_henyey_greenstein(g, (u[i, 0], u[i, 1]))
        found[i, 0] = x
        found[i, 1] = y
        found[i, 2] = z


@entry
def _density(g, wi, found):
    for i in range(len(wi)):
        found[i] = pdf_henyey_greenstein(g, (wi[i, 0], wi[i, 1], wi[i, 2]))


def sampled(g: float) -> np.ndarray:
    found = np.empty((N, 3), np.float32)
    _sample(np.float32(g), np.random.default_rng(1).random((N, 2), np.float32), found)
    return found


def density(g: float, wi: np.ndarray) -> np.ndarray:
    found = np.empty(len(wi), np.float32)
    _density(np.float32(g), np.array(wi, np.float32), found)
    return found


@pytest.mark.parametrize("g", GS)
def test_samples_follow_the_density(g: float) -> None:
    direction_test(sampled(g), lambda w: density(g, w), len(GS), (48, 16), 8, f"g = {g}")


@pytest.mark.parametrize("g", [*GS, 0.999, -0.999])
def test_g_is_the_mean_scattering_cosine(g: float) -> None:
    """g is the mean cosine of the angle to the direction in which the light travels, here -z."""
    cosine = -sampled(g)[:, 2].astype(float)
    assert abs(cosine.mean() - g) <= limit(6) * cosine.std() / np.sqrt(N) + 1e-6
    assert np.abs(np.linalg.norm(sampled(g), axis=1) - 1).max() < 1e-5


def test_pdf_equals_henyey_greensteins_formula() -> None:
    cosine = np.linspace(-1, 1, 101)
    wi = np.stack([np.sqrt(1 - cosine**2), np.zeros(101), -cosine], 1)
    for g in GS:
        expected = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
        assert density(g, wi) == pytest.approx(expected, rel=1e-5)
