"""Tests of diffuse paint under a dielectric coat, against a random walk of photons between paint and coat.

pbrt-v4's LayeredBxDF walks in the same way.
"""

import math

import numpy as np
import pytest

from renderer.scene.readers.coats import dielectric_albedo, effective_albedo_under_coat, internal_albedo
from renderer.scene.readers.metals import normal_reflectance
from renderer.scene.readers.pbrt.coats import coat_of, coated_albedo, coated_metal_reflectance
from tests.renderer.scene.pbrt_files import BALL, HEAD, world

COUNT = 60_000
THICKNESS = 0.01


def test_smooth_clear_coat_matches_closed_form():
    coat = coat_of(1.5, 0.0, 0.0, 1000)
    inner = internal_albedo(1.5)
    assert coat.reflected == pytest.approx(dielectric_albedo(1.5), rel=0.02)
    assert coat.back == pytest.approx(inner, rel=0.01)
    for value in (0.2, 0.5, 0.9):
        assert coated_albedo((value,) * 3, coat)[0] == pytest.approx(
            effective_albedo_under_coat((value,) * 3, inner)[0], rel=0.01
        )


def test_thick_coat_attenuates_exponentially():
    """A coat of thickness t attenuates light by exp(-t / cosine) on its way in, and again on its way out.

    The index of the coat is nearly 1, so that no light is reflected back to the paint.
    """
    clear, dark = (coat_of(1.0001, 0.0, thickness, 2) for thickness in (0.0, 0.5))
    cosine = np.sqrt((np.arange(4096) + 0.5) / 4096)
    once = np.exp(-0.5 / cosine).mean()
    assert coated_albedo((0.5,) * 3, dark)[0] / coated_albedo((0.5,) * 3, clear)[0] == pytest.approx(once**2, rel=0.01)


def boundary(view, ior, alpha, reflects, random):
    """Returns new directions and remaining weights of photons that hit a rough boundary from above (Heitz 2018; Walter 2007)."""
    stretched = view * ((alpha,), (alpha,), (1,))
    stretched /= np.linalg.norm(stretched, axis=0)
    u, v = random.random((2, view.shape[1]))
    z = (1 - u) * (1 + stretched[2]) - stretched[2]
    ring = np.sqrt(np.clip(1 - z * z, 0, 1))
    facet = np.stack([ring * np.cos(2 * np.pi * v), ring * np.sin(2 * np.pi * v), z]) + stretched
    facet *= ((alpha,), (alpha,), (1,))
    facet /= np.linalg.norm(facet, axis=0)
    cosine = (facet * view).sum(axis=0)
    square = (1 - cosine**2) / ior**2
    behind = np.sqrt(np.clip(1 - square, 0, 1))
    fresnel = ((ior * cosine - behind) / (ior * cosine + behind)) ** 2 + ((cosine - ior * behind) / (cosine + ior * behind)) ** 2
    fresnel = np.where(square >= 1, 1.0, fresnel / 2)
    if reflects:
        way, share = 2 * cosine * facet - view, fresnel
    else:
        way, share = (cosine / ior - behind) * facet - view / ior, 1 - fresnel
    up = way[2] if reflects else -way[2]

    def smith(z):
        return (np.sqrt(1 + alpha**2 * (1 / np.maximum(z, 1e-9) ** 2 - 1)) - 1) / 2

    return way, np.where(up > 0, share * (1 + smith(view[2])) / (1 + smith(view[2]) + smith(up)), 0.0)


def matt(random):
    u, v = random.random((2, COUNT))
    return np.stack([np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v), np.sqrt(1 - u)])


def walked(reflectance, ior, alpha):
    """Returns the reflectance of coated paint under uniform light, by a random walk of photons that pass the coat 10 times."""
    random = np.random.default_rng(3)
    way, left = boundary(matt(random), ior, alpha, False, random)
    found = 0.0
    for _ in range(5):
        left = left * np.exp(-THICKNESS / np.maximum(np.abs(way[2]), 1e-9)) * reflectance
        up = matt(random)
        left = left * np.exp(-THICKNESS / up[2])
        found += (left * boundary(up, 1 / ior, alpha, False, random)[1]).mean()
        way, again = boundary(up, 1 / ior, alpha, True, random)
        left = left * again
    return found


@pytest.mark.long
@pytest.mark.parametrize(("ior", "alpha"), [(1.5, math.sqrt(0.1)), (1.5, math.sqrt(0.3)), (1.33, 0.1), (2.0, 0.55)])
def test_rough_coat_reflectance_matches_the_walk(ior, alpha):
    coat = coat_of(ior, round(alpha, 4), THICKNESS, 10)
    for value in (0.2, 0.9):
        ours = coated_albedo((value,) * 3, coat)[0] * (1 - coat.reflected)
        assert ours == pytest.approx(walked(value, ior, alpha), rel=0.015)


def test_coated_materials_in_files(scene):
    def made(words):
        return scene("scene.pbrt", world(f"Material {words} {BALL}", HEAD)).materials[0]

    white = '"coateddiffuse" "rgb reflectance" [.9 .9 .9]'
    assert made(white).base_color[0] == pytest.approx(coated_albedo((0.9,) * 3, coat_of(1.5, 0.0, 0.01, 10))[0])
    rough = made(f'{white} "float roughness" 0.3 "float thickness" 0 "integer maxdepth" 100')
    assert rough.base_color[0] == pytest.approx(coated_albedo((0.9,) * 3, coat_of(1.5, round(math.sqrt(0.3), 4), 0.0, 100))[0])
    assert (
        rough.base_color[0] < 0.6 * made(white).base_color[0] + 0.1
    )  # a smooth coat's formula would make it as bright as `white`
    brushed = made(f'{white} "float uroughness" 0.01 "float vroughness" 0.25')
    assert brushed.base_color[0] == pytest.approx(coated_albedo((0.9,) * 3, coat_of(1.5, 0.2236, 0.01, 10))[0], rel=1e-3)
    # The metal borders the coat instead of air, so eta and k are divided by the coat's index.
    metal = made('"coatedconductor" "rgb reflectance" [.8 .8 .8] "float thickness" 0')
    k = 2 * math.sqrt(0.8 / 0.2)
    bare = normal_reflectance(1 / 1.5, k / 1.5)
    assert bare == pytest.approx(0.7303, abs=1e-4)
    assert metal.base_color[0] == pytest.approx(0.96 * bare / (1 - 0.04 * bare), rel=1e-4)
    assert coated_metal_reflectance(np.array([0.0, 1.0]), 1.5, 0.0) == pytest.approx([0, 1])
