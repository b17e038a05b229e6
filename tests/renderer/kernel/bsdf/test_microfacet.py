"""Tests of the GGX distribution against float64, and of the albedo tables against their generator."""

import math

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.bsdf import brushed_energy, energy, sheen
from renderer.kernel.bsdf.albedo_tables import (
    BRUSHED_NODES,
    SIZE,
    brushed_albedo,
    brushed_means,
    brushed_node,
    ggx_albedo,
    ggx_table,
    mean_over_hemisphere,
    sheen_albedo,
    table_path,
)
from renderer.kernel.bsdf.beckmann import beckmann_density, beckmann_lambda
from renderer.kernel.bsdf.fresnel import fresnel_conductor
from renderer.kernel.bsdf.microfacet import ggx_density, pdf_visible_normal, smith_lambda

DEGREES = (0, 45, 60, 80, 85)


@entry
def _values(alpha, angles, out):
    """Writes for each direction the GGX distribution D of the normal, the masking G1, and the pdf of the visible normal z."""
    for i in range(len(angles)):
        w = (np.float32(np.sin(angles[i])), np.float32(0), np.float32(np.cos(angles[i])))
        up = (np.float32(0), np.float32(0), np.float32(1))
        out[i, 0] = ggx_density(w, alpha, alpha)
        out[i, 1] = np.float32(1) / (np.float32(1) + smith_lambda(w, alpha, alpha))
        out[i, 2] = pdf_visible_normal(w, up, alpha, alpha)


@entry
def _albedos(cosine, roughness, out):
    for i in range(len(cosine)):
        out[i, 0], out[i, 1] = energy.ggx_albedo(cosine[i], roughness[i])
        out[i, 2] = sheen.sheen_albedo(cosine[i], roughness[i])


def test_distribution_and_masking_at_alpha_0_1():
    """D and G1 equal Walter et al. 2007, equations 33 and 34, written with tangents."""
    found = np.empty((len(DEGREES), 3), np.float32)
    _values(np.float32(0.1), np.radians(DEGREES), found)
    for row, degrees in zip(found, DEGREES, strict=True):
        theta, alpha = np.radians(degrees), 0.1
        density = alpha**2 / (np.pi * np.cos(theta) ** 4 * (alpha**2 + np.tan(theta) ** 2) ** 2)
        masking = 2 / (1 + np.sqrt(1 + alpha**2 * np.tan(theta) ** 2))
        np.testing.assert_allclose(row, (density, masking, masking / (np.pi * alpha**2)), rtol=2e-4)
    # The same values, computed by hand.
    np.testing.assert_allclose(found[[0, 1], 0], (31.830989, 0.012481), rtol=1e-4)
    np.testing.assert_allclose(found[[1, 3, 4], 1], (0.997512, 0.930395, 0.794059), rtol=1e-4)


@entry
def _beckmann(alpha, angles, out):
    for i in range(len(angles)):
        w = (np.float32(np.sin(angles[i])), np.float32(0), np.float32(np.cos(angles[i])))
        out[i, 0] = beckmann_density(w, alpha, alpha)
        out[i, 1] = np.float32(1) / (np.float32(1) + beckmann_lambda(w, alpha, alpha))


@pytest.mark.parametrize("alpha", [0.1, 0.5, 1.0])
def test_distribution_and_masking_of_beckmann(alpha):
    """Beckmann's D equals equation 25 of Walter et al. 2007; masking equals the exact formula, not their fit (equation 26)."""
    found = np.empty((len(DEGREES), 2), np.float32)
    _beckmann(np.float32(alpha), np.radians(DEGREES), found)
    for row, degrees in zip(found, DEGREES, strict=True):
        theta = np.radians(degrees)
        density = np.exp(-((np.tan(theta) / alpha) ** 2)) / (np.pi * alpha**2 * np.cos(theta) ** 4)
        a = 1 / (alpha * np.tan(theta)) if degrees else np.inf
        masking = 1.0 if degrees == 0 else 2 / (1 + math.erf(a) + np.exp(-a * a) / (a * np.sqrt(np.pi)))
        np.testing.assert_allclose(row, (density, masking), rtol=3e-4, atol=1e-12)


def test_single_scattering_albedo_of_white_microfacets():
    for alpha, albedo in ((0.25, 0.916), (0.5, 0.688), (0.75, 0.464), (1.0, 1 - np.log(2))):
        assert sum(ggx_albedo(1.0, alpha)) == pytest.approx(albedo, abs=4e-4)


@pytest.mark.long
def test_albedo_tables_match_their_generator():
    """The stored tables equal what their generator computes.

    Compared are all nodes of the microfacet table, some of the sheen table, and the last row of both.
    """
    np.testing.assert_allclose(np.load(table_path("ggx_albedo")), ggx_table(), atol=2e-6)
    table = np.load(table_path("sheen_albedo"))
    for i, j in np.random.default_rng(3).integers(6, SIZE, (60, 2)):
        assert table[i, j] == pytest.approx(sheen_albedo((j / (SIZE - 1)) ** 2, (i / (SIZE - 1)) ** 2), abs=2e-6)
    np.testing.assert_allclose(table[SIZE], [mean_over_hemisphere(row) for row in table[:SIZE].astype(float)], atol=2e-6)


@pytest.mark.parametrize(("name", "distribution"), [("brushed_albedo", "ggx"), ("beckmann_albedo", "beckmann")])
def test_brushed_table_matches_its_generator(name, distribution):
    """The stored table of brushed surfaces equals its generator at some nodes and in all means."""
    table = np.load(table_path(name))
    rng = np.random.default_rng(4)
    for index in zip(*(rng.integers(0, nodes, 80) for nodes in BRUSHED_NODES), strict=True):
        np.testing.assert_allclose(table[index], brushed_node(*map(int, index), distribution), atol=2e-6)
    cosines = BRUSHED_NODES[2]
    means = [[brushed_means(plane[:cosines].astype(float), j) for j, plane in enumerate(row)] for row in table]
    np.testing.assert_allclose(table[:, :, cosines], np.repeat(np.array(means)[:, :, None], BRUSHED_NODES[3], 2), atol=2e-6)


@entry
def _brushed(beckmann, w, alpha, roughness, out):
    for i in range(len(w)):
        direction = (w[i, 0], w[i, 1], w[i, 2])
        out[i, 0], out[i, 1] = brushed_energy.brushed_albedo(beckmann, direction, roughness[i], alpha[i, 0], alpha[i, 1])


@pytest.mark.parametrize(("beckmann", "distribution"), [(0.0, "ggx"), (1.0, "beckmann")])
def test_brushed_lookups_are_accurate(beckmann, distribution):
    rng = np.random.default_rng(2)
    alpha_x = rng.uniform(0.02, 1, 300)
    alpha = np.stack([alpha_x, alpha_x * rng.uniform(0.01, 1, 300)], -1).astype(np.float32)
    cosine, turn = rng.uniform(0.1, 1, 300), rng.uniform(0, 2 * np.pi, 300)
    w = np.stack([np.sqrt(1 - cosine**2) * np.cos(turn), np.sqrt(1 - cosine**2) * np.sin(turn), cosine], -1)
    found = np.empty((300, 2), np.float32)
    _brushed(np.float32(beckmann), w.astype(np.float32), alpha, np.sqrt(alpha.mean(1)), found)
    expected = [brushed_albedo(*row, distribution=distribution) for row in zip(w, *alpha.T.astype(float), strict=True)]
    np.testing.assert_allclose(found, expected, atol=1e-2)
    assert np.sqrt(np.square(found - expected).mean()) < 3e-3


@pytest.mark.long
def test_lookups_between_table_nodes_are_accurate():
    rng = np.random.default_rng(1)
    cosine, roughness = rng.uniform(0.05, 1, 200).astype(np.float32), rng.uniform(0.1, 1, 200).astype(np.float32)
    found = np.empty((200, 3), np.float32)
    _albedos(cosine, roughness, found)
    expected = np.array([ggx_albedo(c, r * r) for c, r in zip(cosine.astype(float), roughness.astype(float), strict=True)])
    np.testing.assert_allclose(found[:, :2], expected, atol=3e-3)


def test_hemisphere_means_match_the_tables():
    table = np.load(table_path("ggx_albedo")).astype(float)
    steps = (np.arange(20_000) + 0.5) / 20_000
    node = np.linspace(0, 1, SIZE)
    for row in (3, 15, 31):
        mean = np.mean(2 * steps * np.interp(np.sqrt(steps), node, table[row, :, 0]))
        assert mean == pytest.approx(table[SIZE, row, 0], abs=1e-4)
        assert mean == pytest.approx(mean_over_hemisphere(table[row, :, 0]), abs=1e-4)


@pytest.mark.parametrize("index", [0.2 + 3.9j, 1.4 + 7.6j, 3.0 + 0.0j])
def test_conductor_reflectance_matches_complex_snell(index):
    for cosine in (1.0, 0.7, 0.3, 0.05):
        inside = np.sqrt(1 - (1 - cosine**2) / index**2)
        s = (cosine - index * inside) / (cosine + index * inside)
        p = (index * cosine - inside) / (index * cosine + inside)
        expected = 0.5 * (abs(s) ** 2 + abs(p) ** 2)
        arguments = (np.float32(cosine), np.float32(index.real), np.float32(index.imag))
        assert fresnel_conductor.py_func(*arguments) == pytest.approx(expected, abs=2e-5)
