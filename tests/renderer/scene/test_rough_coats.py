"""Paint under Mitsuba's rough coats. The numbers are what Mitsuba 3.9's roughplastic gives for bk7 in air, evaluated directly."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.bsdf.metallic_roughness import eval_and_pdf_metallic_roughness
from renderer.scene.readers.coats import coat_over, under_a_coat
from renderer.scene.readers.mitsuba.rough_coats import SEEN_AT, facets_pass, rough_coat

IOR = 1.5046 / 1.000277


@entry
def _evaluate(base, metallic, roughness, f0, f90, wo, wi):
    return eval_and_pdf_metallic_roughness(base, metallic, roughness, f0, f90, wo, wi)


@pytest.mark.parametrize(("alpha", "inner"), [(0.1, 0.554), (0.4, 0.3505), (1.0, 0.1178)])
def test_less_light_is_thrown_back_within_the_rougher_the_coat(alpha, inner):
    assert rough_coat(IOR, alpha).inner == pytest.approx(inner, rel=0.025)


@pytest.mark.parametrize(("cosine", "share"), [(0.2, 0.5275), (0.5, 0.770)])
def test_facets_let_less_through_towards_the_horizon(cosine, share):
    assert facets_pass(cosine, IOR, 1.0)[1] / facets_pass(0.9, IOR, 1.0)[1] == pytest.approx(share, rel=0.01)


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_a_coat_of_hardly_any_roughness_is_a_smooth_one(distribution):
    found = rough_coat(IOR, 0.001, distribution)
    assert found.left == pytest.approx(1.0, abs=0.02)
    assert found.inner == pytest.approx(coat_over(IOR), rel=0.05)
    assert sum(facets_pass(0.9, IOR, 0.001, distribution)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("alpha", "paint", "linear", "nonlinear"),
    [
        (0.1, 0.1, 0.0867, 0.0409),
        (0.4, 0.1, 0.0569, 0.0383),
        (0.4, 0.9, 0.5121, 0.4859),
        (1.0, 0.1, 0.0309, 0.0276),
        (1.0, 0.5, 0.1546, 0.1449),
        (1.0, 0.9, 0.2783, 0.2746),
    ],
)
def test_paint_reflects_as_much_as_in_mitsuba(alpha, paint, linear, nonlinear):
    left, inner = rough_coat(IOR, alpha)
    assert _diffuse(left * paint, alpha) == pytest.approx(linear, rel=0.025)
    assert _diffuse(left * float(under_a_coat(paint, inner)), alpha) == pytest.approx(nonlinear, rel=0.02)


def _diffuse(base: float, alpha: float) -> float:
    """What a base reflects, seen at SEEN_AT under even light."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    sine = np.float32(np.sqrt(1 - SEEN_AT**2))
    total = 0.0
    for cosine, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
        wi = np.float32(0), np.float32(np.sqrt(1 - cosine**2)), np.float32(cosine)
        lit, bare = (_reflected(b, alpha, (sine, np.float32(0), np.float32(SEEN_AT)), wi) for b in (base, 0.0))
        total += 2 * np.pi * weight * (lit - bare)
    return total


def _reflected(base: float, alpha: float, wo, wi) -> float:
    f0 = np.float32(((IOR - 1) / (IOR + 1)) ** 2)
    colour, none, one = np.float32(base), np.float32(0), np.float32(1)
    f, _ = _evaluate((colour,) * 3, none, np.float32(np.sqrt(alpha)), (f0,) * 3, one, wo, wi)
    return float(f[0])
