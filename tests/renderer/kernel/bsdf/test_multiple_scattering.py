"""Tests of white rough metal against a random walk over facets: single scattering, and directions of multiple scattering."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.kernel.bsdf.albedo_tables import ggx_albedo
from renderer.scene.description import Material
from tests.grids import grid
from tests.renderer.kernel.bsdf.facets import walk
from tests.renderer.kernel.subject import Subject

RAYS = 200_000
# One-sided skies, by the axis in which they are brightest; the viewer is at positive x.
SKIES = {"behind": (-1, 0, 0), "side": (0, 1, 0), "viewer": (1, 0, 0), "above": (0, 0, 1)}
# Largest deviation of our picture from the walk's under any of these skies, relative to a white sky: docs/correctness.md.
FARTHEST = {1.0: 0.025, 0.5: 0.015, 0.25: 0.035}


def from_above(cosine: float) -> np.ndarray:
    return np.array([np.sqrt(1 - cosine**2), 0.0, cosine])


def sky(axis: tuple[float, ...], w: np.ndarray) -> np.ndarray:
    return np.asarray(np.maximum(w @ np.array(axis), 0))


@grid("alpha", FARTHEST, ordinary=(0.25,))
@pytest.mark.parametrize("cosine", [0.1, 0.4, 0.8])
def test_single_scattering_matches_the_tables(alpha, cosine):
    _, facets = walk(from_above(cosine), alpha, RAYS, seed=1)
    share = (facets == 1).mean()
    assert abs(share - sum(ggx_albedo(cosine, alpha))) < 4 * np.sqrt(share * (1 - share) / RAYS) + 1e-3


@pytest.mark.long
@grid("alpha", FARTHEST, ordinary=(0.5,))
def test_multiple_scattering_directions_match_the_walk(alpha):
    """The model's directions of multiple scattering differ from the random walk's by a limited amount.

    The model's lobe is diffuse, while the random walk scatters more light forwards.
    """
    white = Subject(
        Material(kind="metallic_roughness", base_color=(1.0, 1.0, 1.0), metallic=1.0, roughness=float(np.sqrt(alpha)))
    )
    for cosine in (0.1, 0.2, 0.4, 0.8):
        wo = from_above(cosine)
        true, _ = walk(wo, alpha, RAYS, seed=2)
        ours, weight, _, _ = white.sample(wo, RAYS)
        for name, axis in SKIES.items():
            light, expected = (weight[:, 0] * sky(axis, ours)).mean(), sky(axis, true).mean()
            assert abs(light - expected) < FARTHEST[alpha], (name, cosine, light, expected)
