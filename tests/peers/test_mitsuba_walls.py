"""Tests that walls of one Mitsuba material match closed forms and Mitsuba's own picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.film import mean
from renderer.image.encode import write
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, chosen
from tests.grids import grid
from tests.peers.facets import walked

SCENE = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{depth}"/></integrator>
<sensor type="orthographic"><transform name="to_world"><scale x="{size}" y="{size}"/><lookat origin="{x}, 0, {z}" target="0, 0, 0"
up="0, 1, 0"/></transform><film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
<rfilter type="box"/></film></sensor>{inside}</scene>"""
WHITE = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
METAL = """<bsdf type="roughconductor"><string name="distribution" value="ggx"/><float name="alpha" value="{}"/>
<rgb name="eta" value="0.2 0.9 1.1"/><rgb name="k" value="3.9 2.4 2.2"/></bsdf>"""
MIRROR = """<bsdf type="roughconductor"><string name="distribution" value="ggx"/><float name="alpha" value="{}"/>
<string name="material" value="none"/></bsdf>"""
GLASS = """<bsdf type="roughdielectric"><string name="distribution" value="ggx"/><float name="alpha" value="{}"/>
<float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>"""
BLUE = '<bsdf type="diffuse"><rgb name="reflectance" value="0.1 0.2 0.7"/></bsdf>'


def mean_colors(
    folder: Path, inside: str, degrees: float = 0.0, depth: int = 2, size: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the mean colours (3,) of our picture and of Mitsuba's. inside: XML of the wall's BSDF and lights."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    x, z = 5 * np.sin(np.radians(degrees)), 5 * np.cos(np.radians(degrees))
    (folder / "scene.xml").write_text(SCENE.format(inside=inside, depth=depth, size=size, x=x, z=z))
    described = read(folder, "scene.xml")
    settings = RenderSettings(16, 16, described.cameras[0].view, **chosen({}, described.defaults))
    sums = render_frame(compile_scene(described), settings, 1024)
    theirs = np.array(mi.render(mi.load_file(str(folder / "scene.xml")), spp=1024), float)[..., :3]
    return mean(sums, settings.film_exponent)[..., :3].mean(axis=(0, 1)), theirs.mean(axis=(0, 1))


def scattered_once(degrees: float, alpha: float) -> float:
    """Returns the fraction of uniform light that a white rough metal reflects after exactly one facet hit.

    Light that hits a second facet counts as lost, by Smith's masking function for GGX. degrees: angle from the view direction to
    the surface normal.
    """
    random = np.random.default_rng(2)
    view = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    stretched = view * (alpha, alpha, 1)
    stretched /= np.linalg.norm(stretched)
    u, v = random.random((2, 400_000))
    z = (1 - u) * (1 + stretched[2]) - stretched[2]
    ring = np.sqrt(np.clip(1 - z * z, 0, 1))
    facet = (np.stack([ring * np.cos(2 * np.pi * v), ring * np.sin(2 * np.pi * v), z], axis=-1) + stretched) * (alpha, alpha, 1)
    facet /= np.linalg.norm(facet, axis=-1, keepdims=True)
    up = 2 * (facet @ view) * facet[:, 2] - view[2]
    shadow = 2 / (1 + np.sqrt(1 + alpha**2 * (1 / np.maximum(up, 1e-9) ** 2 - 1)))
    return float(np.where(up > 0, shadow, 0).mean())


@grid("alpha, degrees", [(0.1, 0), (0.2, 60), (0.2, 0), (0.5, 60)], ordinary=[0.5])
def test_white_metal_is_white_here_and_has_in_mitsuba_what_one_bounce_leaves(
    degrees: float, alpha: float, tmp_path: Path
) -> None:
    wall = f'<shape type="rectangle">{MIRROR.format(alpha)}</shape>'
    ours, theirs = mean_colors(tmp_path, WHITE + wall, degrees)
    np.testing.assert_allclose(ours, 1, atol=3e-3)
    np.testing.assert_allclose(theirs, scattered_once(degrees, alpha), rtol=5e-3)


@pytest.mark.long
@grid("alpha, degrees", [(0.1, 60), (0.2, 0), (0.3, 60)], ordinary=[0.3])
def test_rough_glass_is_what_a_random_walk_between_facets_gives_and_in_mitsuba_the_first_of_them(
    alpha: float, degrees: float, tmp_path: Path
) -> None:
    """Rough glass in uniform light matches a random walk of light between its facets (facets.py).

    Its radiance is the reflected fraction plus the transmitted one divided by 1.5^2, the squared refractive index. Our picture
    includes all facets of the walk; Mitsuba's includes only paths that hit a single facet.
    """
    reflected, through = walked(alpha, degrees, 1.5)
    assert reflected.sum() + through.sum() == pytest.approx(1, abs=1e-4)
    ours, theirs = mean_colors(tmp_path, WHITE + f'<shape type="rectangle">{GLASS.format(alpha)}</shape>', degrees)
    np.testing.assert_allclose(ours, reflected.sum() + through.sum() / 2.25, rtol=4e-3)
    np.testing.assert_allclose(theirs, reflected[1] + through[1] / 2.25, rtol=4e-3)


@grid("weight", [0.3, 0.7], ordinary=[0.3])
def test_a_blend_of_paint_and_metal(weight: float, tmp_path: Path) -> None:
    """A blend of paint and metal in uniform light and below a lamp matches Mitsuba's picture."""
    blend = f'<bsdf type="blendbsdf"><float name="weight" value="{weight}"/>{BLUE}{METAL.format(0.05)}</bsdf>'
    lamp = """<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="2" z="1"/></transform>
    <emitter type="area"><rgb name="radiance" value="4"/></emitter></shape>"""
    ours, theirs = mean_colors(tmp_path, f'{WHITE}{lamp}<shape type="sphere">{blend}</shape>', depth=4, size=1.0)
    np.testing.assert_allclose(ours, theirs, rtol=0.015)


RAMP = """<bsdf type="bumpmap"><texture name="arbitrary" type="bitmap"><boolean name="raw" value="true"/>
<string name="filename" value="ramp.exr"/></texture><float name="scale" value="{}"/>
<bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></bsdf>"""
LAMP = """<emitter type="directional"><vector name="direction" value="0 -1 -1"/><rgb name="irradiance" value="3"/></emitter>"""


def walked_on_a_ramp(slope: float, paths: int = 400_000) -> tuple[float, float]:
    """Returns the radiance of a bump-mapped diffuse ramp, seen from above: (after one reflection, after all reflections).

    The ramp faces away from the lamp. A direction that leads into the surface hits the same facet again, whose normal is then
    bent until the mirror direction leaves the surface (consistent_normals.py).
    """
    random = np.random.default_rng(3)
    lamp, up = np.array([0, 1, 1]) / np.sqrt(2), np.array([0.0, 0.0, 1.0])
    n = np.tile(np.array([0, -slope, 1]) / np.hypot(slope, 1), (paths, 1))
    first = found = 0.0
    for bounce in range(20):
        brought = 0.8 ** (bounce + 1) / np.pi * 3 * np.clip(n @ lamp, 0, None).sum() / paths
        found += brought
        first = first or brought
        u, v = random.random((2, len(n)))
        s = np.cross([1.0, 0.0, 0.0], n)
        s /= np.linalg.norm(s, axis=1, keepdims=True)
        ring = np.sqrt(u)[:, None]
        d = s * ring * np.cos(2 * np.pi * v)[:, None] + np.cross(n, s) * ring * np.sin(2 * np.pi * v)[:, None]
        d += n * np.sqrt(1 - u)[:, None]
        n, wo = n[d[:, 2] < 0], -d[d[:, 2] < 0]
        if not len(n):
            break
        least = np.minimum(0.9 * wo[:, 2], 0.01)
        is_bent = (2 * (n * wo).sum(1) * n[:, 2] - wo[:, 2] < least) | ((n * wo).sum(1) <= 0)
        across = n * (1, 1, 0) / np.maximum(np.linalg.norm(n[:, :2], axis=1, keepdims=True), 1e-9)
        along = (across * wo).sum(1)
        half = (np.arctan2(along, wo[:, 2]) + np.arccos(least / np.hypot(along, wo[:, 2]))) / 2
        bent = across * np.sin(half)[:, None] + up * np.cos(half)[:, None]
        n = np.where(is_bent[:, None], bent, n)
    return first, found


@grid("scale", [0.5, 1.0], ordinary=[0.5])
def test_a_ramp_of_heights_has_what_its_facet_scatters_again_and_in_mitsuba_the_first_vertex(
    scale: float, tmp_path: Path
) -> None:
    heights = np.repeat(np.linspace(0, 1, 64, dtype=np.float32)[:, None, None], 64, 1).repeat(3, 2)
    write(tmp_path / "ramp.exr", heights)
    first, found = walked_on_a_ramp(scale / 2 * 64 / 63)
    ours, theirs = mean_colors(tmp_path, LAMP + f'<shape type="rectangle">{RAMP.format(scale)}</shape>')
    np.testing.assert_allclose(theirs, first, rtol=0.01)
    np.testing.assert_allclose(ours, found, rtol=3e-3)


def test_what_shines_is_black_where_it_names_no_material(tmp_path: Path) -> None:
    """A Mitsuba emitter without a BSDF is black: in uniform light, only the radiance that it emits itself is seen."""
    wall = '<shape type="rectangle"><emitter type="area"><rgb name="radiance" value="0.5 0.25 0.125"/></emitter></shape>'
    ours, theirs = mean_colors(tmp_path, WHITE + wall)
    np.testing.assert_allclose(ours, (0.5, 0.25, 0.125), rtol=1e-4)
    np.testing.assert_allclose(theirs, (0.5, 0.25, 0.125), rtol=1e-4)
