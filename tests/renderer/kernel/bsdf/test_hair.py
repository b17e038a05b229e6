"""Tests of the hair BSDF: energy, samples against their density, published values, and what its parameters mean."""

from __future__ import annotations

import math

import numpy as np
import pytest

from renderer.arrays import rows
from renderer.jit import entry
from renderer.kernel.bsdf.hair import eval_and_pdf_hair, sample_hair
from renderer.scene.description import Material, SceneDescription
from renderer.scene.material_packing import pack
from tests.renderer.judge import direction_test, limit

WHITE = (1.0, 1.0, 1.0)
ROUGHNESSES = ((0.3, 0.3), (0.25, 0.9), (0.9, 0.25))  # wide enough for the bins of a chi-squared test
INCIDENCES = ((0.0, 0.0), (0.6, 0.5), (-1.0, -1.2), (1.35, 0.3))  # theta, and the angle to the normal around the fibre


@entry
def _sample(m, wo, u, wi, weight, pdf):
    for i in range(len(u)):
        d, f, pdf[i] = sample_hair(m, (wo[0], wo[1], wo[2]), u[i, 0], (u[i, 1], u[i, 2]))
        for k in range(3):
            wi[i, k] = d[k]
            weight[i, k] = f[k]


@entry
def _eval(m, wo, wi, f, pdf):
    for i in range(len(wi)):
        value, pdf[i] = eval_and_pdf_hair(m, (wo[0], wo[1], wo[2]), (wi[i, 0], wi[i, 1], wi[i, 2]))
        for k in range(3):
            f[i, k] = value[k]


def parameters(**fields):
    """Returns the row of parameters of a hair material."""
    packed = pack(SceneDescription(materials=[Material(kind="hair", **{"ior": 1.55, **fields})]))
    row = np.zeros(rows.LAYER_SLOTS, np.float32)
    row[: rows.COLUMNS] = packed.material[0]
    return row


def direction(theta, gamma):
    """Returns the local direction of inclination theta, at angle gamma to the normal around the fibre, radians."""
    return np.array((np.sin(theta), -np.cos(theta) * np.sin(gamma), np.cos(theta) * np.cos(gamma)), np.float32)


def samples(m, wo, n=200_000):
    u = np.random.default_rng(3).random((n, 3), np.float32)
    wi, weight, pdf = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
    _sample(m, wo, u, wi, weight, pdf)
    return wi, weight, pdf


def values(m, wo, wi):
    f, pdf = np.empty((len(wi), 3), np.float32), np.empty(len(wi), np.float32)
    _eval(m, wo, np.ascontiguousarray(wi, np.float32), f, pdf)
    return f, pdf


def test_columns_follow_the_paper():
    """The variance, the scale and the absorption are those of Chiang et al.'s equations 7 to 9, worked out by hand for 0.5."""
    row = parameters(beta_m=0.5, beta_n=0.5, base_color=(0.5, 0.5, 0.5), tilt=math.radians(30))
    np.testing.assert_allclose(row[rows.HAIR_VARIANCE], (0.363 + 0.203 + 3.7 * 0.5**20) ** 2, rtol=1e-6)
    np.testing.assert_allclose(row[rows.HAIR_SCALE], 0.626657 * (0.1325 + 0.2985 + 5.372 * 0.5**22), rtol=1e-5)
    np.testing.assert_allclose(row[rows.HAIR_TILT : rows.HAIR_TILT + 2], (0.5, 0.8660254), rtol=1e-6)
    np.testing.assert_allclose(
        1 / row[rows.HAIR_COLOR_SCALE], 5.969 - 0.1075 + 0.633 - 1.34125 + 0.348375 + 0.00765625, rtol=1e-6
    )


def test_pigments_replace_the_colour():
    row = parameters(eumelanin=1.0, pheomelanin=2.0, sigma_a=(0.1, 0.0, 0.0))
    np.testing.assert_allclose(row[rows.ABSORPTION : rows.ABSORPTION + 3], (0.893, 1.497, 3.47), rtol=1e-6)
    assert row[rows.BASE : rows.BASE + 3].tolist() == [1, 1, 1]


@pytest.mark.long
@pytest.mark.parametrize("roughness", [*ROUGHNESSES, (0.05, 0.05)])
@pytest.mark.parametrize("place", INCIDENCES)
def test_white_hair_in_a_white_furnace(roughness, place):
    """Without absorption every sample carries all light: the lobes' attenuations add up to 1."""
    m = parameters(base_color=WHITE, beta_m=roughness[0], beta_n=roughness[1])
    _, weight, pdf = samples(m, direction(*place), 20_000)
    assert (pdf > 0).all()
    np.testing.assert_allclose(weight, 1, atol=2e-5)


@pytest.mark.long
@pytest.mark.parametrize("roughness", ROUGHNESSES)
@pytest.mark.parametrize("place", INCIDENCES)
def test_samples_follow_their_density(roughness, place):
    m, wo = parameters(eumelanin=0.3, beta_m=roughness[0], beta_n=roughness[1], tilt=0.1), direction(*place)
    wi, weight, pdf = samples(m, wo)
    # Bins by the angle along the fibre and the azimuth around it: all azimuths meet in the fibre's direction.
    direction_test(wi[:, (1, 2, 0)], lambda w: values(m, wo, w[:, (2, 0, 1)])[1], 12, (48, 48), 8, f"{roughness} at {place}")
    f, again = values(m, wo, wi)
    np.testing.assert_allclose(again, pdf, rtol=1e-5)
    np.testing.assert_allclose(weight * pdf[:, None], f, rtol=1e-4)


@pytest.mark.long
def test_fibre_without_reflection_that_absorbs_all_light_is_black():
    """No lobe has light then, in proportion to which they are sampled; the pdf is 0, not NaN."""
    m = parameters(ior=1.0, sigma_a=(1e6, 1e6, 1e6))
    wo = direction(0.2, 0.3)
    _, weight, pdf = samples(m, wo, 100)
    assert not weight.any() and not pdf.any()
    f, pdf = values(m, wo, np.array([direction(-0.1, 2.0)]))
    assert not f.any() and not pdf.any()


@pytest.mark.long
@pytest.mark.parametrize("beta_n", [0.25, 0.5, 0.9])
def test_fibres_of_brighter_colours_are_brighter(beta_n):
    """A single fibre reflects more than its colour, which is that of many scattering events in a volume of hair."""
    albedos = []
    for grey in (0.1, 0.4, 0.8):
        m = parameters(base_color=(grey, grey, grey), beta_n=beta_n)
        offsets = (np.arange(16) + 0.5) / 8 - 1
        albedos.append(np.mean([samples(m, direction(0.0, np.arcsin(h)), 4000)[1][:, 0].mean() for h in offsets]))
        assert albedos[-1] > grey
    assert albedos == sorted(albedos)


@pytest.mark.long
def test_smooth_fibre_reflects_and_transmits_where_a_cylinder_does():
    """Samples of a nearly smooth fibre without tilt leave at the azimuths of the cylinder's geometric optics (Marschner 2003)."""
    m = parameters(base_color=WHITE, beta_m=0.05, beta_n=0.05, tilt=0.0)
    gamma = 0.5
    wi, _, _ = samples(m, direction(0.0, gamma), 50_000)
    inside = math.asin(math.sin(gamma) / 1.55)
    turned = np.arctan2(-wi[:, 1], wi[:, 2])
    for p in range(3):
        away = 2 * p * inside - 2 * gamma + p * math.pi + gamma
        close = np.abs((turned - away + math.pi) % (2 * math.pi) - math.pi) < 0.1
        fresnel = 0.5 * sum(
            ((a - b) / (a + b)) ** 2
            for a, b in (
                (math.cos(gamma), 1.55 * math.cos(inside)),
                (1.55 * math.cos(gamma), math.cos(inside)),
            )
        )
        share = fresnel if p == 0 else (1 - fresnel) ** 2 * fresnel ** (p - 1)
        assert abs(close.mean() - share) < 0.02 + limit(3) * math.sqrt(share / 50_000), p


@pytest.mark.long
def test_mirrored_directions_have_the_same_value():
    """The model is symmetric about the plane of the fibre and the normal."""
    m, flip = parameters(), np.float32((1, -1, 1))
    wi = samples(m, direction(0.4, 0.3), 5000)[0]
    f, pdf = values(m, direction(0.4, 0.3), wi)
    mirrored, again = values(m, direction(0.4, -0.3), wi * flip)
    np.testing.assert_allclose(mirrored, f, rtol=2e-4, atol=1e-5)
    np.testing.assert_allclose(again, pdf, rtol=2e-4, atol=1e-5)
