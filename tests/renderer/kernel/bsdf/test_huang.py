"""Tests of the hair BSDF of elliptic fibres: energy, samples against their density, reciprocity, and Chiang's model."""

from __future__ import annotations

import math

import numpy as np
import pytest

from renderer.arrays import rows
from renderer.jit import entry
from renderer.kernel.bsdf.hair import sample_hair
from renderer.kernel.bsdf.huang import eval_and_pdf_huang, sample_huang
from renderer.scene.description import Material, SceneDescription
from renderer.scene.material_packing import pack
from tests.renderer.judge import direction_test
from tests.renderer.kernel.bsdf.test_hair import direction
from tests.renderer.kernel.bsdf.test_hair import parameters as chiang_parameters

WHITE = (1.0, 1.0, 1.0)
CASES = (  # roughness, aspect ratio, theta, the normal's angle to the minor axis
    (0.75, 1.0, 0.0, 0.0),
    (0.75, 0.6, 0.6, 1.0),
    (0.9, 0.3, -0.8, -0.4),
)


@entry
def _sample(beckmann, m, wo, u, wi, weight, pdf):
    for i in range(len(u)):
        d, f, pdf[i] = sample_huang(beckmann, m, (wo[i, 0], wo[i, 1], wo[i, 2]), u[i, 0], (u[i, 1], u[i, 2]))
        for k in range(3):
            wi[i, k] = d[k]
            weight[i, k] = f[k]


@entry
def _eval(beckmann, m, wo, wi, f, pdf):
    for i in range(len(wi)):
        value, pdf[i] = eval_and_pdf_huang(beckmann, m, (wo[i, 0], wo[i, 1], wo[i, 2]), (wi[i, 0], wi[i, 1], wi[i, 2]))
        for k in range(3):
            f[i, k] = value[k]


@entry
def _sample_chiang(m, wo, u, wi, weight, pdf):
    for i in range(len(u)):
        d, f, pdf[i] = sample_hair(m, (wo[i, 0], wo[i, 1], wo[i, 2]), u[i, 0], (u[i, 1], u[i, 2]))
        for k in range(3):
            wi[i, k] = d[k]
            weight[i, k] = f[k]


def parameters(turn=0.0, **fields):
    """Returns the row of parameters of a hair material where the normal has an angle to the minor axis of the cross-section."""
    material = Material(kind="hair", model="huang", **{"ior": 1.55, "base_color": WHITE, **fields})
    packed = pack(SceneDescription(materials=[material]))
    row = np.zeros(rows.LAYER_SLOTS, np.float32)
    row[: rows.COLUMNS] = packed.material[0]
    row[rows.ALPHA_X] = row[rows.ALPHA_Y] = max(row[rows.ROUGHNESS] ** 2, 1e-3)
    row[rows.HUANG_NORMAL : rows.HUANG_NORMAL + 2] = math.sin(turn), math.cos(turn)
    return row


def samples(m, wo, n=200_000, seed=3, beckmann=0.0):
    """Returns (wi, weight, pdf) of n samples. wo: (3,) or (n, 3)."""
    u = np.random.default_rng(seed).random((n, 3), np.float32)
    wi, weight, pdf = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
    _sample(np.float32(beckmann), m, np.ascontiguousarray(np.broadcast_to(wo, (n, 3)), np.float32), u, wi, weight, pdf)
    return wi, weight, pdf


def values(m, wo, wi, beckmann=0.0):
    f, pdf = np.empty((len(wi), 3), np.float32), np.empty(len(wi), np.float32)
    wo = np.ascontiguousarray(np.broadcast_to(wo, wi.shape), np.float32)
    _eval(np.float32(beckmann), m, wo, np.ascontiguousarray(wi, np.float32), f, pdf)
    return f, pdf


def across(n, theta, seed, spread=0.05):
    """Returns (n, 3) local directions towards a viewer of inclination theta: rays at random offsets across a round fibre."""
    random = np.random.default_rng(seed)
    thetas, gammas = theta + random.uniform(-spread, spread, n), np.arcsin(random.uniform(-1, 1, n))
    return np.stack([np.sin(thetas), -np.cos(thetas) * np.sin(gammas), np.cos(thetas) * np.cos(gammas)], axis=1)


def about_fibre(wi, wo):
    """Returns local directions wi rotated about the fibre into the frame in which the viewer wo is at the azimuth 0."""
    turn = np.arctan2(wo[:, 1], wo[:, 2])
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([wi[:, 0], wi[:, 1] * c - wi[:, 2] * s, wi[:, 1] * s + wi[:, 2] * c], axis=1)


def test_columns():
    row = parameters(aspect_ratio=0.7, r=0.5, trt=0.25, roughness=0.5)
    np.testing.assert_allclose(row[rows.HUANG_ASPECT], 0.7, rtol=1e-6)
    np.testing.assert_allclose(row[rows.HUANG_SHARES : rows.HUANG_SHARES + 3], (0.5, 1.0, 0.25))
    assert rows.HUANG_NORMAL + 1 < rows.SHININESS
    assert pack(SceneDescription(materials=[Material(kind="hair", model="huang")])).material_kind.tolist() == [rows.HUANG]
    np.testing.assert_allclose(parameters()[rows.ALPHA_Y], 0.3025)  # unless given


@pytest.mark.long
@pytest.mark.parametrize(("roughness", "most"), [(0.1, 0.01), (0.55, 0.01), (0.8, 0.02), (1.0, 0.03)])
@pytest.mark.parametrize("theta", [0.0, 0.6, -1.1])
def test_white_hair_in_a_white_furnace(roughness, most, theta):
    """Fibres that absorb nothing scatter all light, but for what facets lose that the tilted scales hide, and at most `most`."""
    weight = samples(parameters(roughness=roughness), across(60_000, theta, 1), 60_000)[1][:, 0]
    error = weight.std() / np.sqrt(len(weight))
    assert abs(weight.mean() - 1) < most + 4 * error


@pytest.mark.long
@pytest.mark.parametrize("turn", [0.0, 0.7, 1.5])
def test_white_elliptic_hair_in_a_white_furnace(turn):
    """The mean over the shifts of the lattice at one point of the ellipse."""
    random = np.random.default_rng(2)
    wo = direction(0.3, 0.2) + 1e-3 * random.normal(size=(60_000, 3))
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    weight = samples(parameters(turn, roughness=0.4, aspect_ratio=0.6, tilt=0.0), wo, 60_000)[1][:, 0]
    assert abs(weight.mean() - 1) < 0.01 + 4 * weight.std() / np.sqrt(len(weight))


@pytest.mark.long
@pytest.mark.parametrize("beckmann", [0.0, 1.0])
@pytest.mark.parametrize("case", CASES)
def test_samples_follow_their_density(case, beckmann):
    roughness, aspect, theta, turn = case
    m, wo = parameters(turn, roughness=roughness, aspect_ratio=aspect, base_color=(0.6, 0.4, 0.2)), direction(theta, 0.3)
    wi, weight, pdf = samples(m, wo, beckmann=beckmann)
    kept = pdf > 0
    shown = np.where(kept[:, None], wi, np.nan)[:, (1, 2, 0)]
    direction_test(shown, lambda w: values(m, wo, w[:, (2, 0, 1)], beckmann)[1], 12, (48, 48), 8, str(case))
    f, again = values(m, wo, wi[kept], beckmann)
    np.testing.assert_allclose(again, pdf[kept], rtol=1e-5)
    np.testing.assert_allclose(weight[kept] * pdf[kept][:, None], f, rtol=1e-4)


@pytest.mark.long
def test_far_field_is_reciprocal():
    """The mean over the width, times the cosine to the plane across the fibre, is the same for light the other way.

    Of an untilted fibre that is nearly smooth, as the factor that makes up for shadowed facets depends on one of the directions.
    """
    n = 400_000
    m = parameters(roughness=0.35, tilt=0.0, base_color=(0.5, 0.5, 0.5), trt=0.0)
    for theta_o, theta_i, azimuth in ((0.2, -0.5, 0.6), (0.1, -0.4, 2.6), (0.5, -0.3, 3.0)):
        sums = []
        for a, b, seed in ((theta_o, theta_i, 1), (theta_i, theta_o, 2)):
            wo = across(n, a, seed, 0.0)
            turn = np.arctan2(-wo[:, 1], wo[:, 2]) - azimuth
            wi = np.stack([np.full(n, np.sin(b)), -np.cos(b) * np.sin(turn), np.cos(b) * np.cos(turn)], axis=1)
            f = values(m, wo, wi)[0][:, 0].astype(float) * np.cos(a)
            sums.append((f.mean(), f.std() / np.sqrt(n)))
        error = np.hypot(sums[0][1], sums[1][1])
        assert abs(sums[0][0] - sums[1][0]) < 0.01 * sums[0][0] + 4 * error, (theta_o, theta_i, azimuth, sums)


@pytest.mark.long
def test_nearly_smooth_round_hair_is_that_of_chiang():
    """Light by lobe, and where each sends it on average, are Chiang's for a smooth fibre."""
    n, shares = 60_000, np.eye(3)
    wo = across(n, 0.3, 5, 0.0)
    chiang = chiang_parameters(beta_m=0.05, beta_n=0.05, tilt=0.0, base_color=(0.5, 0.5, 0.5))
    wi, weight, pdf = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
    _sample_chiang(chiang, wo.astype(np.float32), np.random.default_rng(1).random((n, 3), np.float32), wi, weight, pdf)
    facing = about_fibre(wi, wo)
    theirs = [weight[:, 0].mean(), *(weight[:, :1] * facing).mean(axis=0)]
    ours = np.zeros(4)
    for r, tt, trt in shares:
        m = parameters(roughness=0.1, tilt=0.0, base_color=(0.5, 0.5, 0.5), r=r, tt=tt, trt=trt)
        wi, weight, pdf = samples(m, wo, n)
        ours += [weight[:, 0].mean(), *(weight[:, :1] * about_fibre(wi, wo)).mean(axis=0)]
    np.testing.assert_allclose(ours, theirs, atol=0.01)
