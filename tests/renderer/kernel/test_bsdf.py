"""Scattering models: what is sampled follows its density, weights are eval over density, light is neither made nor directed."""

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.bsdf.fresnel import fresnel_dielectric
from renderer.kernel.material import LAYER_SLOTS, Material, eval_material, sample_material
from renderer.kernel.rows import DIFFUSE, GLASS, METALLIC_ROUGHNESS, MIRROR
from tests.renderer.judge import chi_squared, direction_test, limit

WHITE = (1.0, 1.0, 1.0)
COLOR = (0.9, 0.5, 0.2)
# (kind, base, metallic, roughness, ior)
SMOOTH_AND_ROUGH = [
    (METALLIC_ROUGHNESS, COLOR, metallic, roughness, 1.5) for metallic in (0.0, 0.5, 1.0) for roughness in (0.35, 0.6, 1.0)
]
MODELS = [(DIFFUSE, COLOR, 0.0, 1.0, 1.5), *SMOOTH_AND_ROUGH]
ANGLES = (0, 45, 80)


@entry
def _sample(kind, base, metallic, roughness, f0, f90, eta, layers, wo, u, wi, weight, pdf):
    material = Material(kind, (base[0], base[1], base[2]), metallic, roughness, (f0, f0, f0), f90, eta, layers)
    for i in range(len(u)):
        w = (wo[i, 0], wo[i, 1], wo[i, 2])
        d, f, p, scale = sample_material(material, w, u[i, 0], (u[i, 1], u[i, 2]))
        for k in range(3):
            wi[i, k] = d[k]
            weight[i, k] = f[k]
        pdf[i, 0] = p
        pdf[i, 1] = scale


@entry
def _eval(kind, base, metallic, roughness, f0, f90, eta, layers, wo, wi, f, pdf):
    material = Material(kind, (base[0], base[1], base[2]), metallic, roughness, (f0, f0, f0), f90, eta, layers)
    for i in range(len(wi)):
        value, pdf[i] = eval_material(material, (wo[i, 0], wo[i, 1], wo[i, 2]), (wi[i, 0], wi[i, 1], wi[i, 2]))
        for k in range(3):
            f[i, k] = value[k]


def arguments(model, front=True):
    kind, base, metallic, roughness, ior = model
    eta = np.float32(ior if front else 1 / ior)
    layers = np.zeros(LAYER_SLOTS, np.float32)
    return (
        np.int32(kind),
        np.array(base, np.float32),
        np.float32(metallic),
        np.float32(roughness),
        np.float32(((ior - 1) / (ior + 1)) ** 2),
        np.float32(1),
        eta,
        layers,
    )


def many(vector, n):
    return np.ascontiguousarray(np.broadcast_to(np.asarray(vector, np.float32), (n, 3)))


def sample(model, wo, n=200_000, front=True, seed=0):
    """(wi, weight, pdf, scale) for wo (3,) or (n, 3)."""
    u = np.random.default_rng(seed).random((n, 3), np.float32)
    wi, weight, pdf = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty((n, 2), np.float32)
    _sample(*arguments(model, front), many(wo, n), u, wi, weight, pdf)
    return wi, weight, pdf[:, 0], pdf[:, 1]


def evaluate(model, wo, wi):
    """(f |cos|, pdf)."""
    n = len(wi)
    f, pdf = np.empty((n, 3), np.float32), np.empty(n, np.float32)
    _eval(*arguments(model), many(wo, n), np.ascontiguousarray(wi, np.float32), f, pdf)
    return f, pdf


def tilted(degrees, turn=0.7):
    a = np.radians(degrees)
    return np.array((np.sin(a) * np.cos(turn), np.sin(a) * np.sin(turn), np.cos(a)))


def hemisphere(n, seed):
    z, turn = np.random.default_rng(seed).random((2, n))
    z = 0.02 + 0.98 * z
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(2 * np.pi * turn), r * np.sin(2 * np.pi * turn), z], 1).astype(np.float32)


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("model", MODELS, ids=str)
def test_samples_follow_their_density(model, degrees):
    wo = tilted(degrees)
    wi, _, pdf, _ = sample(model, wo)
    kept = np.where((pdf > 0)[:, None], wi, np.nan)
    name = f"{model} at {degrees}"
    direction_test(kept, lambda w: evaluate(model, wo, w)[1], len(MODELS) * len(ANGLES), (64, 64), 12, name)


@pytest.mark.parametrize("degrees", ANGLES)
def test_a_sharp_lobe_follows_its_density(degrees):
    """Roughness 0.1, alpha 0.01: its directions are binned about the mirror's, in steps of the lobe's own width."""
    model = (METALLIC_ROUGHNESS, WHITE, 1.0, 0.1, 1.5)
    wo = tilted(degrees)
    n = 200_000
    wi, _, pdf, _ = sample(model, wo, n)
    axis = np.array((-wo[0], -wo[1], wo[2]))
    s = np.cross(axis, (0.3, -0.8, 0.52))
    s /= np.linalg.norm(s)
    frame = np.stack([s, np.cross(axis, s), axis])
    reach, bins, fine = 0.12, 40, 8
    # Gnomonic coordinates: the solid angle of dx dy is (1 + x^2 + y^2)^(-3/2).
    local = wi[pdf > 0].astype(float) @ frame.T
    local = local[local[:, 2] > 0.5]
    counts, _, _ = np.histogram2d(local[:, 0] / local[:, 2], local[:, 1] / local[:, 2], bins, [(-reach, reach)] * 2)
    side = (np.arange(bins * fine) + 0.5) / (bins * fine) * 2 * reach - reach
    x, y = np.meshgrid(side, side, indexing="ij")
    grid = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
    solid_angle = (grid**2).sum(1) ** -1.5 * (2 * reach / (bins * fine)) ** 2
    unit = grid / np.linalg.norm(grid, axis=1, keepdims=True) @ frame
    mass = (evaluate(model, wo, unit)[1].astype(float) * solid_angle).reshape(bins, fine, bins, fine).sum((1, 3))
    assert 0.9 < mass.sum() < 1.001
    expected = np.append(mass.ravel(), 1 - mass.sum()) * n
    chi_squared(np.append(counts.ravel(), n - counts.sum()), expected, len(ANGLES), f"sharp at {degrees}")


@pytest.mark.parametrize("model", [*MODELS, (METALLIC_ROUGHNESS, COLOR, 0.3, 0.05, 1.5)], ids=str)
def test_a_samples_weight_is_eval_over_density(model):
    wo = hemisphere(20_000, 1)
    wi, weight, pdf, scale = sample(model, wo, len(wo))
    good = pdf > 0
    f, again = evaluate(model, wo[good], wi[good])
    np.testing.assert_allclose(again, pdf[good], rtol=1e-5)
    np.testing.assert_allclose(weight[good] * pdf[good, None], f, rtol=1e-4, atol=1e-6)
    assert (weight[~good] == 0).all()
    assert (scale == 1).all()
    assert np.isfinite(weight).all()
    np.testing.assert_allclose(np.linalg.norm(wi[good], axis=1), 1, atol=3e-6)


@pytest.mark.parametrize("model", MODELS, ids=str)
def test_scattering_is_reciprocal(model):
    """f(wo, wi) = f(wi, wo), over a grid of directions that both reach grazing."""
    wo, wi = hemisphere(20_000, 2), hemisphere(20_000, 3)
    there, _ = evaluate(model, wo, wi)
    back, _ = evaluate(model, wi, wo)
    np.testing.assert_allclose(there / wi[:, 2:], back / wo[:, 2:], rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("degrees", [0, 30, 60, 70, 80])
def test_no_more_light_leaves_than_came(degrees):
    """White of every metallic and roughness, by the mean weight and by integrating eval; and no less to half a per cent."""
    z, turn = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(400) + 0.5) / 400 * 2 * np.pi, indexing="ij")
    r = np.sqrt(1 - z * z)
    grid = np.stack([r * np.cos(turn), r * np.sin(turn), z], -1).reshape(-1, 3)
    for metallic in (0.0, 0.5, 1.0):
        for roughness in (0.3, 0.6, 1.0):
            model = (METALLIC_ROUGHNESS, WHITE, metallic, roughness, 1.5)
            _, weight, _, _ = sample(model, tilted(degrees), 20_000)
            error = weight[:, 0].std() / np.sqrt(len(weight))
            albedo = weight[:, 0].mean(dtype=np.float64)
            assert abs(albedo - 1) <= 0.005 + limit(45) * error
            integral = evaluate(model, tilted(degrees), grid)[0][:, 0].mean(dtype=np.float64) * 2 * np.pi
            assert abs(albedo - integral) < limit(45) * error + 4e-3


@pytest.mark.parametrize("model", MODELS, ids=str)
def test_nothing_is_scattered_below_the_horizon(model):
    below = hemisphere(2000, 4) * np.float32((1, 1, -1))
    f, pdf = evaluate(model, tilted(30), below)
    assert not f.any()
    assert not pdf.any()
    wi, weight, pdf, _ = sample(model, tilted(80))
    assert (wi[weight.any(1), 2] > 0).all()


@pytest.mark.parametrize("roughness", [0.0, 0.02, 1.0])
@pytest.mark.parametrize("degrees", [0, 60, 89.9, 90 - 1e-4])
def test_extremes_stay_finite(roughness, degrees):
    for metallic in (0.0, 1.0):
        model = (METALLIC_ROUGHNESS, WHITE, metallic, roughness, 1.5)
        wi, weight, pdf, _ = sample(model, tilted(degrees), 20_000)
        for values in (wi, weight, pdf, *evaluate(model, tilted(degrees), wi)):
            assert np.isfinite(values).all()
        assert weight.max() < 20


def test_mirror():
    wo = hemisphere(1000, 5)
    wi, weight, pdf, scale = sample((MIRROR, COLOR, 0.0, 1.0, 1.5), wo, 1000)
    np.testing.assert_array_equal(wi, wo * np.float32((-1, -1, 1)))
    assert (weight == np.float32(COLOR)).all()
    assert (pdf == 0).all()
    assert (scale == 1).all()


def fresnel(cosine, eta):
    """Unpolarised reflectance in double precision, by Snell's angle and the tangent and sine laws."""
    a = np.arccos(cosine)
    b = np.arcsin(np.sin(a) / eta)
    return 0.5 * ((np.sin(a - b) / np.sin(a + b)) ** 2 + (np.tan(a - b) / np.tan(a + b)) ** 2)


def test_fresnel_is_fresnels():
    for cosine in np.linspace(0.05, 0.995, 40):
        for eta in (1.33, 1.5, 2.4):
            assert fresnel_dielectric.py_func(np.float32(cosine), np.float32(eta))[0] == pytest.approx(
                fresnel(cosine, eta), abs=1e-5
            )
            sine2 = 1 - cosine * cosine
            if sine2 < 0.98 / eta**2:
                found = fresnel_dielectric.py_func(np.float32(cosine), np.float32(1 / eta))[0]
                assert found == pytest.approx(fresnel(cosine, 1 / eta), abs=1e-4)
            elif sine2 > 1.02 / eta**2:
                assert fresnel_dielectric.py_func(np.float32(cosine), np.float32(1 / eta)) == (1, 0)
    assert fresnel_dielectric.py_func(np.float32(1), np.float32(1.5))[0] == pytest.approx(0.04, abs=1e-6)


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("degrees", [0, 30, 60])
def test_glass_reflects_as_often_as_fresnel_says_and_bends_as_snell_says(front, degrees):
    ior, tint, n = 1.5, (1.0, 0.5, 0.25), 100_000
    eta = ior if front else 1 / ior
    wo = tilted(degrees)
    wi, weight, pdf, scale = sample((GLASS, tint, 0.0, 1.0, ior), wo, n, front)
    through = wi[:, 2] < 0
    sine = np.sin(np.radians(degrees))
    expected = 1.0 if sine > eta else (0.04 if degrees == 0 else fresnel(np.cos(np.radians(degrees)), eta))
    spread = np.sqrt(expected * (1 - expected) / n)
    assert abs((~through).mean() - expected) <= limit(6) * spread + 1e-6
    assert (pdf == 0).all()
    assert (weight[~through] == 1).all()
    assert (scale[~through] == 1).all()
    np.testing.assert_allclose(wi[~through], many(wo * (-1, -1, 1), (~through).sum()), atol=1e-6)
    if through.any():
        np.testing.assert_allclose(wi[through, :2], many(-wo / eta, through.sum())[:, :2], atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(wi[through], axis=1), 1, atol=1e-6)
        np.testing.assert_allclose(weight[through] * scale[through, None], many(tint, through.sum()), rtol=1e-6)
        np.testing.assert_allclose(scale[through], eta**2, rtol=1e-6)
