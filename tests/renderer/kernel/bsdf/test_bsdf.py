"""Tests of all materials: samples follow their pdf, weight = eval / pdf, and energy conservation and reciprocity hold."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from renderer.arrays.rows import HAIR, HUANG, KINDS
from renderer.scene.description import Material, SceneDescription
from renderer.scene.material_packing import pack
from tests.grids import grid
from tests.renderer.judge import chi_squared, direction_test, limit
from tests.renderer.kernel.subject import Subject, hemisphere, many, tilted

WHITE = (1.0, 1.0, 1.0)
COLOR = (0.9, 0.5, 0.2)
GOLD = {"eta": (0.18, 0.42, 1.37), "k": (3.42, 2.35, 1.77)}
ANGLES = (0, 45, 80)


def principled(**fields):
    return Material(**{"kind": "metallic_roughness", "base_color": COLOR, "roughness": 0.5, **fields})


# Lobes wide enough for the bins of a chi-squared test.
MODELS = {
    "diffuse": Material(base_color=COLOR),
    "plastic": principled(roughness=0.35),
    "half metal": principled(metallic=0.5, roughness=0.6),
    "metal": principled(metallic=1.0, roughness=1.0),
    "tinted specular": principled(specular=0.7, specular_color=(1.0, 0.6, 0.2), ior=1.8),
    "conductor": Material(kind="conductor", roughness=0.5, **GOLD),
    "brushed conductor": Material(kind="conductor", roughness=0.45, anisotropy=0.6, anisotropy_rotation=0.9, **GOLD),
    "blinn-phong": Material(kind="blinn_phong", base_color=(0.5, 0.3, 0.1), specular_color=(0.4, 0.4, 0.4), shininess=20.0),
    "rough glass": Material(kind="glass", base_color=COLOR, roughness=0.8),
    "Beckmann conductor": Material(kind="conductor", roughness=0.5, distribution="beckmann", **GOLD),
    "brushed Beckmann conductor": Material(
        kind="conductor", roughness=0.45, anisotropy=0.6, anisotropy_rotation=0.9, distribution="beckmann", **GOLD
    ),
    "Beckmann glass": Material(kind="glass", base_color=COLOR, roughness=0.8, distribution="beckmann"),
    "Beckmann metal": principled(metallic=1.0, roughness=1.0, distribution="beckmann"),
    "coated paint": Material(kind="plastic", base_color=COLOR, roughness=0.5, specular_color=(1.0, 0.8, 0.5)),
    "paint under a Beckmann coat": Material(
        kind="plastic", base_color=COLOR, roughness=0.7, distribution="beckmann", nonlinear=True, ior=1.8
    ),
    "rough pane": Material(kind="glass", base_color=COLOR, roughness=0.5, thin=True),
    "half transmission": principled(transmission=0.5, metallic=0.2, roughness=0.8),
    "leaf": principled(diffuse_transmission=0.6, diffuse_transmission_color=(0.3, 0.8, 0.1)),
    "clearcoat": principled(clearcoat=1.0, clearcoat_roughness=0.4, metallic=0.8, roughness=0.7),
    "sheen": principled(sheen_color=(0.8, 0.6, 1.0), sheen_roughness=0.5, roughness=0.9),
    "anisotropic": principled(anisotropy=0.7, anisotropy_rotation=0.5, metallic=1.0, roughness=0.45),
    "iridescent": principled(iridescence=0.9, iridescence_thickness=(300.0, 450.0), metallic=0.5),
    "everything": principled(
        metallic=0.3, transmission=0.4, thin=True, diffuse_transmission=0.5, clearcoat=0.7, clearcoat_roughness=0.5,
        sheen_color=(0.5, 0.4, 0.3), sheen_roughness=0.6, anisotropy=0.4, iridescence=0.5, roughness=0.6,
    ),
}  # fmt: skip
FROM_BOTH_SIDES = ("rough glass", "Beckmann glass", "half transmission")
CASES = [(name, True) for name in MODELS] + [(name, False) for name in FROM_BOTH_SIDES]


def test_every_scattering_kind_is_tested():
    """MODELS has an entry for every kind of material that scatters, except hair, which test_hair.py and test_huang.py test.

    The chi-squared tests of the entries fail if a kernel has no branch for the kind.
    """
    kinds = pack(SceneDescription(materials=list(MODELS.values()))).material_kind.tolist()
    stages = ("diffuse", "metallic_roughness", "conductor", "rare")
    assert {kind.number for kind in KINDS if kind.stage in stages} == {*kinds, HAIR, HUANG}


@pytest.fixture(scope="module")
def subjects():
    return {(name, front): Subject(MODELS[name], front) for name, front in CASES}


def sphere(n, seed):
    """Returns random directions, none of them nearly horizontal."""
    w = hemisphere(n, seed)
    w[::2, 2] *= -1
    return w


# At 80 degrees lobes are cut off by the horizon. At 0 the direction has no azimuth, which anisotropy and several lobes use.
ORDINARY_AT_80 = ("metal", "rough glass", "leaf", "everything", "brushed Beckmann conductor", "paint under a Beckmann coat")
ORDINARY_AT_0 = ("everything", "brushed Beckmann conductor")


def is_ordinary(name, degrees):
    return (degrees == 80 and name in ORDINARY_AT_80) or (degrees == 0 and name in ORDINARY_AT_0)


@grid(
    ("case", "degrees"),
    [pytest.param((name, front), degrees, id=f"{name}-{front}-{degrees}") for name, front in CASES for degrees in ANGLES],
    ordinary=[f"{name}-{front}-{degrees}" for name, front in CASES for degrees in ANGLES if is_ordinary(name, degrees)],
)
def test_samples_follow_their_density(subjects, case, degrees):
    subject, wo, name = subjects[case], tilted(degrees), case[0]
    wi, _, pdf, _ = subject.sample(wo)
    kept = np.where((pdf > 0)[:, None], wi, np.nan)
    tests = len(CASES) * len(ANGLES)
    direction_test(kept, lambda w: subject.eval(wo, w)[1], tests, (48, 48), 8, f"{name} at {degrees}")


@grid("degrees", ANGLES, ordinary=(80,))
@grid("name", ["metal", "coat", "glass", "conductor"], ordinary=("coat", "conductor"))
def test_sharp_lobe_samples_follow_the_density(name, degrees):
    """Samples of a sharp lobe (roughness 0.1, alpha 0.01) follow their density, in bins of the lobe's width around its centre."""
    sharp = {
        "metal": principled(metallic=1.0, roughness=0.1),
        "coat": principled(base_color=(0.0, 0.0, 0.0), specular=0.0, clearcoat=1.0, clearcoat_roughness=0.1),
        "glass": Material(kind="glass", roughness=0.1, ior=1.4),
        "conductor": Material(kind="conductor", roughness=0.1, **GOLD),
    }
    subject, wo, n = Subject(sharp[name]), tilted(degrees), 200_000
    wi, _, pdf, _ = subject.sample(wo, n)
    axis = np.array((-wo[0], -wo[1], wo[2]))
    if name == "glass":
        axis = np.array((-wo[0] / 1.4, -wo[1] / 1.4, -np.sqrt(1 - (wo[0] ** 2 + wo[1] ** 2) / 1.4**2)))
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
    mass = (subject.eval(wo, unit)[1].astype(float) * solid_angle).reshape(bins, fine, bins, fine).sum((1, 3))
    assert (0.3 if name in ("glass", "coat") else 0.85) < mass.sum() < 1.001
    expected = np.append(mass.ravel(), 1 - mass.sum()) * n
    chi_squared(np.append(counts.ravel(), n - counts.sum()), expected, 4 * len(ANGLES), f"{name} at {degrees}")


@grid(("name", "front"), CASES)
def test_sample_weight_equals_eval_over_pdf(subjects, name, front):
    wo = hemisphere(20_000, 1)
    wi, weight, pdf, scale = subjects[name, front].sample(wo, len(wo))
    good = pdf > 0
    f, again = subjects[name, front].eval(wo[good], wi[good])
    np.testing.assert_allclose(again, pdf[good], rtol=1e-4)
    np.testing.assert_allclose(weight[good] * pdf[good, None], f, rtol=1e-3, atol=1e-5)
    assert (weight[~good] == 0).all()
    refracted = (wi[:, 2] < 0) & good & (name in FROM_BOTH_SIDES)
    eta = MODELS[name].ior if front else 1 / MODELS[name].ior
    assert (scale[~refracted] == 1).all()
    np.testing.assert_allclose(scale[refracted], eta**2, rtol=1e-6)
    assert np.isfinite(weight).all()
    np.testing.assert_allclose(np.linalg.norm(wi[good], axis=1), 1, atol=1e-5)


def assert_reciprocal(material, wo, wi, name=""):
    """Asserts f(wo, wi) = f(wi, wo); for transmission with the sides exchanged, and without the radiance scale of eta^2."""
    through = wi[:, 2] < 0
    refracts = material.transmission > 0 or material.kind == "glass"
    if refracts and material.diffuse_transmission > 0:  # only one of two lobes that scatter below has the radiance scale
        material = replace(material, thin=True)
    squeeze = material.ior**2 if refracts and not material.thin else 1.0
    there, _ = Subject(material).eval(wo, wi)
    back = np.where(through[:, None], 0, Subject(material).eval(np.where(through[:, None], wo, wi), wo)[0])
    if through.any():
        beyond, flip = Subject(material, front=material.thin), np.array((1, 1, -1))
        back[through] = beyond.eval(wi[through] * flip, wo[through] * flip)[0] / squeeze
    there, back = there / abs(wi[:, 2:]), back / wo[:, 2:]
    np.testing.assert_allclose(there, back, rtol=2e-3, atol=2e-5 * max(there.max(), 1e-3), err_msg=name)


@grid("name", MODELS)
def test_scattering_is_reciprocal(name):
    assert_reciprocal(MODELS[name], hemisphere(4000, 2), sphere(4000, 3))


unit = st.floats(0, 1)
metals = st.builds(
    Material,
    kind=st.just("conductor"),
    roughness=st.floats(0.1, 1),
    anisotropy=st.one_of(st.just(0.0), st.floats(0, 0.75)),
    eta=st.tuples(*[st.floats(0.05, 4)] * 3),
    k=st.tuples(*[st.floats(0, 8)] * 3),
    distribution=st.sampled_from(("ggx", "beckmann")),
)
plastics = st.builds(
    Material,
    kind=st.just("plastic"),
    base_color=st.tuples(*[st.floats(0, 1)] * 3),
    roughness=st.floats(0.15, 1),
    ior=st.floats(1.0, 2.5),
    nonlinear=st.booleans(),
    distribution=st.sampled_from(("ggx", "beckmann")),
)
phong = st.builds(
    Material,
    kind=st.just("blinn_phong"),
    base_color=st.tuples(unit, unit, unit),
    specular_color=st.tuples(unit, unit, unit),
    shininess=st.floats(0, 200),
)
surfaces = st.builds(
    principled,
    base_color=st.tuples(unit, unit, unit),
    metallic=unit,
    roughness=st.floats(0.2, 1),
    ior=st.floats(1.125, 2.5),
    specular=unit,
    specular_color=st.tuples(unit, unit, unit),
    transmission=st.one_of(st.just(0.0), unit),
    thin=st.booleans(),
    diffuse_transmission=st.one_of(st.just(0.0), unit),
    diffuse_transmission_color=st.tuples(unit, unit, unit),
    clearcoat=st.one_of(st.just(0.0), unit),
    clearcoat_roughness=st.floats(0.1, 1),
    sheen_color=st.one_of(st.just((0.0, 0.0, 0.0)), st.tuples(unit, unit, unit)),
    sheen_roughness=unit,
    anisotropy=st.one_of(st.just(0.0), st.floats(0, 0.75)),
    anisotropy_rotation=st.floats(0, 6),
    iridescence=st.one_of(st.just(0.0), unit),
    distribution=st.sampled_from(("ggx", "beckmann")),
    iridescence_ior=st.floats(1, 2),
    iridescence_thickness=st.tuples(st.just(100.0), st.floats(0, 800)),
)


anything = st.one_of(surfaces, surfaces, surfaces, metals, phong, plastics)


@settings(derandomize=True)
@given(anything)
def test_random_materials_are_reciprocal(material):
    assert_reciprocal(material, hemisphere(300, 2), sphere(300, 3), str(material))


@settings(derandomize=True)
@given(anything, st.floats(0, 85), st.booleans())
def test_random_materials_conserve_energy(material, degrees, front):
    n = 4000
    _, weight, _, scale = Subject(material, front).sample(tilted(degrees), n)
    assert np.isfinite(weight).all()
    carried = (weight * scale[:, None]).astype(float)
    error = carried.std(0) / np.sqrt(n)
    # The albedo of iridescent surfaces is known only to a few per cent.
    slack = 0.01 + 0.03 * (material.iridescence > 0)
    assert (carried.mean(0) <= 1 + slack + limit(180) * error).all()


@grid("degrees", (0, 30, 60, 80))
@grid("roughness", (0.1, 0.3, 0.6, 1.0))
@pytest.mark.parametrize(
    ("what", "least"),
    [
        ({}, 0.995),
        ({"metallic": 0.5}, 0.995),
        ({"metallic": 1.0}, 0.995),
        ({"transmission": 1.0, "thin": True}, 0.995),
        ({"transmission": 1.0}, 0.99),
        ({"diffuse_transmission": 0.5}, 0.995),
        ({"clearcoat": 1.0}, 0.97),  # base facets get the lesser of inward and outward transmittance
        ({"sheen_color": WHITE, "sheen_roughness": 0.5}, 0.97),
        ({"metallic": 1.0, "clearcoat": 1.0}, 0.93),
        ({"kind": "conductor", "eta": (0.0, 0.0, 0.0), "k": (1e4, 1e4, 1e4)}, 0.995),
        ({"metallic": 1.0, "distribution": "beckmann"}, 0.995),
        ({"transmission": 1.0, "distribution": "beckmann"}, 0.99),
    ],
    ids=str,
)
def test_white_in_a_white_furnace(what, least, roughness, degrees):
    _, weight, _, scale = Subject(principled(base_color=WHITE, roughness=roughness, **what)).sample(tilted(degrees), 40_000)
    carried = (weight[:, 0] * scale).astype(np.float64)
    albedo, error = carried.mean(), carried.std() / 200
    assert least - limit(160) * error <= albedo <= 1.005 + limit(160) * error


BRUSHED = [
    {},
    {"metallic": 0.5},
    {"metallic": 1.0},
    {"diffuse_transmission": 0.5},
    {"kind": "conductor", "eta": (0.0, 0.0, 0.0), "k": (1e4, 1e4, 1e4)},
    {"metallic": 1.0, "distribution": "beckmann"},
]


def furnaces():
    """Yields parameters of brushed materials and view directions: extremes always, others only with --long.

    The others are an orthogonal array, 12 of 108 places for each material: any two values of two parameters occur together.
    """
    levels = BRUSHED, (0.5, 0.8, 1.0), (0.15, 0.35, 0.7), (0, 60, 80, 86), (0, 45, 90)
    for cell in itertools.product(*(enumerate(values) for values in levels)):
        (m, a, r, d, t), (what, *place) = zip(*cell, strict=True)
        is_extreme = all(at in values for at, values in zip(place, ((1.0,), (0.15, 0.7), (80,), (0, 90)), strict=True))
        if is_extreme or (m + a + r - t) % 3 == (m + a + 2 * r - d) % 3 == 0:
            yield pytest.param(what, *place, marks=() if is_extreme else pytest.mark.long, id=str((what, *place)))


FURNACES = list(furnaces())


@pytest.mark.parametrize(("what", "anisotropy", "roughness", "degrees", "turn"), FURNACES)
def test_white_brushed_metal_in_a_white_furnace(what, anisotropy, roughness, degrees, turn):
    """White brushed materials reflect all light: in constant light their albedo is 1, within 1 % plus the statistical error.

    They are seen along the grooves, across them and in between; along and across are the extremes of what single scattering
    loses.
    """
    n = 40_000
    brushed = principled(base_color=WHITE, roughness=roughness, anisotropy=anisotropy, **what)
    _, weight, _, scale = Subject(brushed).sample(tilted(degrees, np.radians(turn)), n)
    carried = (weight[:, 0] * scale).astype(np.float64)
    albedo, error = carried.mean(), carried.std() / np.sqrt(n)
    assert abs(albedo - 1) <= 0.01 + limit(len(FURNACES)) * error


@grid("name", [n for n in MODELS if n not in (*FROM_BOTH_SIDES, "rough pane", "leaf", "everything")])
def test_an_opaque_material_scatters_nothing_below_the_horizon(subjects, name):
    f, pdf = subjects[name, True].eval(tilted(30), hemisphere(2000, 4) * np.float32((1, 1, -1)))
    assert not f.any()
    assert not pdf.any()
    wi, weight, pdf, _ = subjects[name, True].sample(tilted(80))
    assert (wi[weight.any(1), 2] > 0).all()


@grid("roughness", [0.0, 0.02, 1.0])
@grid("degrees", [0, 60, 89.9, 90 - 1e-4])
@grid("name", ["plastic", "metal", "everything"], ordinary=("everything",))
def test_extreme_parameters_stay_finite(name, degrees, roughness):
    fields = {**vars(MODELS[name]), "base_color": WHITE, "roughness": roughness}
    subject = Subject(Material(**fields))
    wi, weight, pdf, _ = subject.sample(tilted(degrees), 20_000)
    for values in (wi, weight, pdf, *subject.eval(tilted(degrees), wi)):
        assert np.isfinite(values).all()
    assert weight.max() < 25


def test_mirror():
    wo = hemisphere(1000, 5)
    wi, weight, pdf, scale = Subject(Material(kind="mirror", base_color=COLOR)).sample(wo, 1000)
    np.testing.assert_array_equal(wi, wo * np.float32((-1, -1, 1)))
    assert (weight == np.float32(COLOR)).all()
    assert (pdf == 0).all()
    assert (scale == 1).all()


def fresnel(cosine, eta):
    """Returns the unpolarised reflectance in float64, by Snell's law and the tangent and sine laws; complex eta for metals."""
    a = np.arccos(cosine + 0j)
    b = np.arcsin(np.sin(a) / eta)
    return float(0.5 * (abs(np.sin(a - b) / np.sin(a + b)) ** 2 + abs(np.tan(a - b) / np.tan(a + b)) ** 2))


@pytest.mark.parametrize("degrees", [10, 45, 70, 85])
def test_smooth_conductor_follows_fresnel(degrees):
    wi, weight, pdf, _ = Subject(Material(kind="conductor", **GOLD)).sample(tilted(degrees), 10)
    expected = [fresnel(np.cos(np.radians(degrees)), e + 1j * k) for e, k in zip(GOLD["eta"], GOLD["k"], strict=True)]
    np.testing.assert_allclose(weight, many(expected, 10), rtol=1e-4)
    np.testing.assert_allclose(wi, many(tilted(degrees) * (-1, -1, 1), 10), atol=1e-6)
    assert (pdf == 0).all()


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize("degrees", [0, 30, 60])
@pytest.mark.parametrize("kind", ["glass", "metallic_roughness"])
def test_glass_follows_fresnel_and_snell(kind, front, degrees):
    ior, tint, n = 1.5, (1.0, 0.5, 0.25), 100_000
    eta = ior if front else 1 / ior
    wo = tilted(degrees)
    material = Material(kind=kind, base_color=tint, ior=ior, roughness=0.0, transmission=1.0)
    wi, weight, pdf, scale = Subject(material, front).sample(wo, n)
    through = wi[:, 2] < 0
    sine = np.sin(np.radians(degrees))
    expected = 1.0 if sine > eta else (0.04 if degrees == 0 else fresnel(np.cos(np.radians(degrees)), eta))
    spread = np.sqrt(expected * (1 - expected) / n)
    assert abs((~through).mean() - expected) <= limit(12) * spread + 1e-6
    assert (pdf == 0).all()
    assert (weight[~through] == 1).all()
    assert (scale[~through] == 1).all()
    np.testing.assert_allclose(wi[~through], many(wo * (-1, -1, 1), (~through).sum()), atol=1e-6)
    if through.any():
        np.testing.assert_allclose(wi[through, :2], many(-wo / eta, through.sum())[:, :2], atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(wi[through], axis=1), 1, atol=1e-6)
        np.testing.assert_allclose(weight[through] * scale[through, None], many(tint, through.sum()), rtol=1e-6)
        np.testing.assert_allclose(scale[through], eta**2, rtol=1e-6)


def test_smooth_pane_transmits_without_refraction():
    wo = tilted(50)
    wi, weight, pdf, scale = Subject(Material(kind="glass", base_color=COLOR, thin=True)).sample(wo, 1000)
    through = wi[:, 2] < 0
    assert 0.8 < through.mean() < 1
    np.testing.assert_allclose(wi[through], many(-wo, through.sum()), atol=1e-6)
    np.testing.assert_allclose(weight[through], many(COLOR, through.sum()), rtol=1e-4)
    assert (pdf == 0).all()
    assert (scale == 1).all()


def test_film_of_zero_thickness_has_no_effect():
    wo, wi = hemisphere(1000, 6), hemisphere(1000, 7)
    bare, _ = Subject(principled(metallic=1.0, anisotropy=1e-6)).eval(wo, wi)
    film, _ = Subject(principled(metallic=1.0, iridescence=1.0, iridescence_thickness=(0.0, 0.0))).eval(wo, wi)
    np.testing.assert_allclose(film, bare, rtol=0.02, atol=1e-3)
