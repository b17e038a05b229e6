"""Tests that BSDFs return the same results for eight lanes as for each lane alone."""

import numpy as np

from renderer.jit import device, entry
from renderer.kernel.bsdf.conductor import eval_and_pdf_conductor, sample_conductor, sample_smooth_conductor
from renderer.kernel.bsdf.diffuse import eval_diffuse, pdf_diffuse, sample_diffuse
from renderer.kernel.bsdf.energy import ggx_albedo, ggx_mean_albedo, multiple_scattering, schlick_mean
from renderer.kernel.bsdf.fresnel import fresnel_conductor, fresnel_dielectric, mean_fresnel_dielectric, schlick
from renderer.kernel.bsdf.glass import sample_glass
from renderer.kernel.bsdf.metallic_roughness import eval_and_pdf_metallic_roughness, sample_metallic_roughness
from renderer.kernel.bsdf.microfacet import MIN_ALPHA, ggx_density, pdf_visible_normal, sample_visible_normal, smith_lambda
from renderer.kernel.bsdf.mirror import sample_mirror
from tests.renderer.wide.both import assert_same_bits, both, in_both
from tests.renderer.wide.given import SMALL, N, directions, square


def roughnesses(rng, n=N):
    """Returns random roughnesses, some too smooth for float32, some above 1."""
    roughness = rng.random(n)
    roughness[:8] = 0, 0, 1e-4, 0.02, 1, 1, 1.25, 0.5
    return roughness


def pairs(rng, n=N):
    """Returns (n, 6): a direction above the horizon and one on either side, with grazing and perpendicular ones."""
    wo, wi = directions(rng, n, above=True), directions(rng, n)
    wi[: n // 2, 2] = abs(wi[: n // 2, 2])
    wo[8:16] = (0, 0, 1), (1, 0, 1e-4), (1, 0, 1e-6), (0, 1, 0), (0.6, 0, 0.8), (0.6, 0, 0.8), (1, 0, 1e-3), (0.6, 0, -0.8)
    wi[8:16] = (0, 0, 1), (-1, 0, 1e-4), (0, 1, 1e-6), (0, 0, 1), (-0.6, 0, 0.8), (0.6, 0, 0), (0.6, 0, -0.8), (0, 0, 1)
    wo[:8], wi[:8] = wo[8:16], wi[8:16]
    return np.concatenate([wo, wi], 1)


def assert_scatters_alike(eight, one, given):
    """Asserts that the results for eight lanes (`eight`) and for each lane alone (`one`) have the same bits.

    Results 0 to 3, f and pdf, must be 0 for a direction below the horizon, and the pdf positive for others.
    """
    below = (given[:, 2] <= 0) | (given[:, 5] <= 0)
    np.testing.assert_array_equal(eight[:4, below], 0)
    assert (eight[3, ~below] > 0).all()
    assert_same_bits(eight, one)


@device
def _boundaries_formula(v):
    cosine, eta, k, u = v[2], v[3], v[4], v[5]
    wo, tint = (v[0], v[1], v[2]), (v[4], v[5], v[6])
    wi, weight, transmitted = sample_glass(tint, eta, wo, u)
    mirrored, reflectance = sample_mirror(tint, wo)
    smooth = *fresnel_dielectric(cosine, eta), fresnel_conductor(cosine, eta, k), mean_fresnel_dielectric(eta)
    return *smooth, *schlick(tint, u, cosine), *wi, *weight, transmitted, *mirrored, *reflectance


@entry
def _boundaries(given, order, eight, one):
    in_both(_boundaries_formula, 7, given, order, eight, one)


def test_smooth_boundaries():
    """Smooth boundaries scatter alike, also with indices below 1 and total reflection, where no refraction is computed."""
    rng = np.random.default_rng(3)
    given = np.concatenate([directions(rng, above=True), rng.random((N, 4))], 1).astype(np.float32)
    given[:, 3] = rng.uniform(0.4, 2.5, N)
    given[:3, :3] = (0, 0, 1), (1, 0, 0), (1, 0, 1e-6)
    given[3:8, 3] = 1, 1.5, 1 / 1.5, 0.4, 1
    given[::9, 5] = 0
    eight, one = both(_boundaries, given, 20)
    total = given[:, 2].astype(float) ** 2 < 1 - given[:, 3].astype(float) ** 2
    assert 0.1 < total.mean() < 0.5
    np.testing.assert_array_equal(eight[:2, total], [[1], [0]] * np.ones((2, total.sum())))
    np.testing.assert_array_equal(eight[13, total], 0)
    assert_same_bits(eight, one)


@device
def _diffuse_formula(v):
    albedo, wo, wi = (v[3], v[4], v[5]), (v[0], v[1], v[2]), (v[6], v[7], v[8])
    found, weight, pdf = sample_diffuse(albedo, wo, (v[4], v[5]))
    return *eval_diffuse(albedo, wo, wi), pdf_diffuse(wo, wi), *found, *weight, pdf


@entry
def _diffuse(given, order, eight, one):
    in_both(_diffuse_formula, 9, given, order, eight, one)


def test_diffuse():
    rng = np.random.default_rng(4)
    given = np.concatenate([directions(rng, above=True), rng.random((N, 1)), square(rng), directions(rng)], 1)
    eight, one = both(_diffuse, given, 11)
    assert_same_bits(eight, one)
    np.testing.assert_array_equal(eight[:4, given[:, 8] <= 0], 0)


@device
def _facets_formula(v):
    w, alpha_x, alpha_y, u = (v[0], v[1], v[2]), v[6], v[7], (v[8], v[9])
    h = sample_visible_normal(w, alpha_x, alpha_y, u)
    g = v[3], v[4], abs(v[5])
    densities = ggx_density(g, alpha_x, alpha_y), pdf_visible_normal(w, g, alpha_x, alpha_y), smith_lambda(w, alpha_x, alpha_y)
    return (
        *h,
        *ggx_albedo(v[5], v[6]),
        *ggx_mean_albedo(v[6]),
        schlick_mean(v[8], v[9]),
        multiple_scattering(v[8], v[9]),
        *densities,
    )


@entry
def _facets(given, order, eight, one):
    in_both(_facets_formula, 10, given, order, eight, one)


def test_microfacets_and_their_energy():
    rng = np.random.default_rng(5)
    alpha = np.maximum(np.stack([roughnesses(rng) ** 2, rng.random(N)], 1), MIN_ALPHA)
    given = np.concatenate([pairs(rng), alpha, square(rng)], 1)
    eight, one = both(_facets, given, 12)
    assert_same_bits(eight, one)


def test_nan_lane_reads_inside_the_table():
    given = np.full((8, 10), np.nan, np.float32)
    given[::2, :3] = np.inf
    given[::2, 5:8] = -np.inf
    for found in both(_facets, given, 12):
        albedos = found[3:7]
        assert ((albedos >= 0) & (albedos <= 1)).all()


@device
def _metallic_formula(v):
    wo, wi, u = (v[0], v[1], v[2]), (v[3], v[4], v[5]), (v[6], v[7])
    base, f0 = (v[8], v[9], v[10]), (v[11], v[12], v[13])
    metallic, roughness, f90, choose = v[14], v[15], v[16], v[17]
    f, pdf = eval_and_pdf_metallic_roughness(base, metallic, roughness, f0, f90, wo, wi)
    found, weight, density = sample_metallic_roughness(base, metallic, roughness, f0, f90, wo, choose, u)
    return *f, pdf, *found, *weight, density


@entry
def _metallic(given, order, eight, one):
    in_both(_metallic_formula, 18, given, order, eight, one)


def test_metallic_roughness():
    rng = np.random.default_rng(6)
    given = np.concatenate([pairs(rng), square(rng), rng.random((N, 10))], 1)
    given[:, 11:14] *= 0.1
    given[:, 15] = np.maximum(roughnesses(rng), 0.0)
    given[:8, 14] = 0, 1, 0, 1, 0, 1, 0, 1
    given[:4, 17], given[4:8, 17] = 0, 1 - SMALL
    given[8:16, 17] = 0, 0, 0, 0, 1 - SMALL, 1 - SMALL, 0, 0
    assert_scatters_alike(*both(_metallic, given, 11), given)


@device
def _conductors_formula(v):
    wo, wi, u = (v[0], v[1], v[2]), (v[3], v[4], v[5]), (v[6], v[7])
    eta, k, mean = (v[8], v[9], v[10]), (v[11], v[12], v[13]), (v[14], v[15], v[16])
    roughness, alpha_x, alpha_y, choose = v[17], v[18], v[19], v[20]
    f, pdf = eval_and_pdf_conductor(None, eta, k, mean, roughness, alpha_x, alpha_y, wo, wi)
    found, weight, density = sample_conductor(None, eta, k, mean, roughness, alpha_x, alpha_y, wo, choose, u)
    mirrored, reflectance = sample_smooth_conductor(eta, k, wo)
    return *f, pdf, *found, *weight, density, *mirrored, *reflectance


@entry
def _conductors(given, order, eight, one):
    in_both(_conductors_formula, 21, given, order, eight, one)


def test_conductors():
    """Rough and brushed conductors scatter alike, in lanes of mixed kinds and in lanes of one kind."""
    rng = np.random.default_rng(10)
    roughness = np.maximum(roughnesses(rng), MIN_ALPHA**0.5)
    alpha = np.stack([roughness**2, roughness**2 * rng.uniform(0.05, 1, N)], 1)
    even = rng.random(N) < 0.5
    even[800:1600], even[1600:2400] = True, False
    alpha[even, 1] = alpha[even, 0]
    metal = [rng.uniform(0.1, 3, (N, 3)), rng.uniform(1, 7, (N, 3)), rng.uniform(0.3, 1, (N, 3))]
    given = np.concatenate(
        [pairs(rng), square(rng), *metal, roughness[:, None], np.maximum(alpha, MIN_ALPHA), rng.random((N, 1))], 1
    )
    given[:4, 20], given[4:8, 20] = 0, 1 - SMALL
    eight, one = both(_conductors, given, 17)
    assert_scatters_alike(eight[:11], one[:11], given)
    assert_same_bits(eight[11:], one[11:])
