"""Tests of rough plastic against Mitsuba 3.9's roughplastic: reflectance under constant light, by the same quadrature."""

import numpy as np
import pytest

from renderer.kernel.bsdf.albedo_tables import COAT_NODES, MOST_BEND, facets_pass, mean_over_hemisphere, table_path
from renderer.scene.description import Material
from tests.renderer.kernel.subject import Subject, tilted

DEGREES = (0, 30, 60, 75, 85)
IOR = 1.5
PAINT = 0.5
# Quadrature over the hemisphere: Gauss-Legendre nodes of the cosine, midpoints of the azimuth.
_COSINES, _AZIMUTHS = 24, 32

REFLECTED = {  # (distribution, alpha, nonlinear) -> reflectances at DEGREES
    ("ggx", 0.1, False): (0.4743, 0.4751, 0.4837, 0.4273, 0.3435),
    ("ggx", 0.1, True): (0.3087, 0.3099, 0.3272, 0.2941, 0.2401),
    ("ggx", 0.3, False): (0.3635, 0.3628, 0.3655, 0.3695, 0.3617),
    ("ggx", 0.3, True): (0.2777, 0.2777, 0.2857, 0.2976, 0.2981),
    ("ggx", 1.0, False): (0.1742, 0.1672, 0.1404, 0.1198, 0.1045),
    ("ggx", 1.0, True): (0.1641, 0.1577, 0.1329, 0.1142, 0.1005),
    ("beckmann", 0.1, False): (0.5037, 0.5046, 0.5203, 0.4116, 0.2458),
    ("beckmann", 0.1, True): (0.3139, 0.3151, 0.3406, 0.2627, 0.1465),
    ("beckmann", 0.3, False): (0.4570, 0.4584, 0.4684, 0.4916, 0.5138),
    ("beckmann", 0.3, True): (0.3067, 0.3088, 0.3273, 0.3647, 0.4004),
    ("beckmann", 1.0, False): (0.2634, 0.2638, 0.2629, 0.2561, 0.2508),
    ("beckmann", 1.0, True): (0.2311, 0.2320, 0.2333, 0.2299, 0.2282),
}


@pytest.mark.parametrize(("distribution", "alpha", "nonlinear"), REFLECTED)
def test_plastic_reflects_as_much_as_in_mitsuba(distribution, alpha, nonlinear):
    wi, weight = _quadrature()
    found = [(_plastic(distribution, alpha, nonlinear).eval(tilted(d, 0.0), wi)[0][:, 0] * weight).sum() for d in DEGREES]
    np.testing.assert_allclose(found, REFLECTED[distribution, alpha, nonlinear], rtol=0.025)


def test_plastic_matches_mitsuba_by_direction():
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    wi, _ = _quadrature()
    paint = {"type": "rgb", "value": PAINT}
    source = {"type": "roughplastic", "alpha": 0.3, "int_ior": IOR, "ext_ior": 1.0, "diffuse_reflectance": paint}
    for distribution, nonlinear in (("ggx", True), ("beckmann", False)):
        theirs = mi.load_dict(source | {"distribution": distribution, "nonlinear": nonlinear})
        for degrees in (30, 75):
            surface = mi.SurfaceInteraction3f()
            surface.wi = mi.Vector3f(*tilted(degrees, 0.0).tolist())
            expected = [np.ravel(theirs.eval(mi.BSDFContext(), surface, mi.Vector3f(*w)))[0] for w in wi.tolist()]
            found = _plastic(distribution, 0.3, nonlinear).eval(tilted(degrees, 0.0), wi)[0][:, 0]
            np.testing.assert_allclose(found, expected, atol=0.02 * max(expected))


def test_coat_with_index_of_air_only_masks():
    wi, weight = _quadrature()
    bare = Material(kind="plastic", base_color=(PAINT,) * 3, roughness=0.3, ior=1.0)
    assert (Subject(bare).eval(tilted(45), wi)[0][:, 0] * weight).sum() == pytest.approx(PAINT, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_coat_table_matches_its_generator(distribution):
    """The stored table of coats equals its generator at some nodes."""
    table = np.load(table_path(f"{distribution}_coat"))
    bends, roughnesses, cosines = COAT_NODES
    heights = np.maximum((np.arange(cosines) / (cosines - 1)) ** 2, 1e-4)
    rng = np.random.default_rng(5)
    for k, i in zip(rng.integers(0, bends, 6), rng.integers(0, roughnesses, 6), strict=True):
        bend = k / (bends - 1) * MOST_BEND
        eta, alpha = (1 + bend) / (1 - bend), max((i / (roughnesses - 1)) ** 2, 1e-3)
        passed = [facets_pass(c, eta, alpha, distribution)[1] for c in heights.tolist()]
        np.testing.assert_allclose(table[k, i, :-1], passed, atol=2e-6)
        inner = mean_over_hemisphere(np.array([facets_pass(c, 1 / eta, alpha, distribution)[0] for c in heights.tolist()]))
        assert table[k, i, -1] == pytest.approx(inner, abs=2e-6)


def _plastic(distribution, alpha, nonlinear):
    paint = {"base_color": (PAINT,) * 3, "roughness": alpha**0.5, "ior": IOR}
    return Subject(Material(kind="plastic", distribution=distribution, nonlinear=nonlinear, **paint))


def _quadrature():
    """Returns directions (N, 3) and their solid-angle weights."""
    node, share = np.polynomial.legendre.leggauss(_COSINES)
    z, turn = np.meshgrid((node + 1) / 2, (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS * 2 * np.pi, indexing="ij")
    r = np.sqrt(1 - z * z)
    wi = np.stack([r * np.cos(turn), r * np.sin(turn), z], -1).reshape(-1, 3).astype(np.float32)
    return wi, np.repeat(share / 2, _AZIMUTHS) * 2 * np.pi / _AZIMUTHS
