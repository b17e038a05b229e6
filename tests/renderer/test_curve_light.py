"""Tests of light on curves: round ones are as bright as tubes and do not occlude themselves; flat ones face the ray."""

from dataclasses import replace

import numpy as np
import pytest

from renderer.arrays.kernel_variant import strip_absent_features, variant_of
from renderer.bvh.traverse import NO_PRIMITIVE, any_hit, closest_hit, new_stack
from renderer.film import mean
from renderer.jit import entry, subroutine
from renderer.kernel import vec
from renderer.kernel.surface.ray_origins import offset_ray_origin
from renderer.kernel.surface.surface import surface_at
from renderer.reference import Packed, by_reference
from renderer.render import render_frame
from renderer.scene.curve_meshes import has_curves, round_tubes
from renderer.scene.description import Light, Material
from renderer.scene.readers.strands import Strand, strands_mesh
from tests.renderer.builders import gray, scene, settings

pytestmark = pytest.mark.long

HAIR = Material(kind="hair", base_color=gray(0.6))
SUN = Light("directional", intensity=(1.0, 1.0, 1.0), direction=(-0.5, -0.75, -0.55))


@pytest.mark.parametrize("scale", [0.05, 1.0])
def test_sunlit_segments_are_as_bright_as_tubes(scale: float) -> None:
    """The scales of the fibre are tilted towards its root, so a mirrored frame would change its brightness by a third."""
    height = np.linspace(-3, 3, 9)
    points = np.column_stack([0.05 * height + 0.3, height, np.full(9, 0.2)]) * scale
    curve = strands_mesh([Strand(points, np.full(9, 0.03 * scale))], fibres=True)
    assert has_curves(curve)
    found = []
    for mesh in (curve, round_tubes(curve, sides=48)):
        lit = scene([HAIR], (mesh,), lights=(SUN,))
        assert variant_of(lit) == "hair"
        view = settings((0, 0, 6 * scale), (0, 0, 0), fov=8, size=32, max_depth=2)
        found.append(mean(render_frame(lit, view, 256), view.film_exponent).mean())
    assert found[0] > 1e-4
    assert found[0] == pytest.approx(found[1], rel=0.05)


@subroutine
def _transmit_all(scene, stack, o, d, away, found):
    for i in range(len(o)):
        origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
        out = away[i, 0], away[i, 1], away[i, 2]
        hit = closest_hit(scene.bvh, stack, origin, direction, np.float32(np.inf), None)
        if hit.primitive != NO_PRIMITIVE:
            surface = surface_at(scene, origin, direction, hit)
            if vec.dot(surface.geometric, out) < np.float32(0):
                found[i, 0] = True
                found[i, 1] = any_hit(scene.bvh, stack, offset_ray_origin(surface, False, out), out, np.float32(np.inf), None)


@entry
def _transmit(scene, stack, o, d, away, found):
    _transmit_all(by_reference(scene), stack, o, d, away, found)


def test_bent_fibres_do_not_occlude_light_that_they_transmit() -> None:
    """Rays out of the plane of a bent fibre hit it again in less than 1 % of the cases, although segments overlap at bends."""
    radius, turn, random = 0.05, np.linspace(0, 1.5, 9), np.random.default_rng(1)
    arc = Strand(np.column_stack([np.cos(turn), np.sin(turn), 0 * turn]), np.full(9, radius))
    made = strip_absent_features(scene([HAIR], (strands_mesh([arc], fibres=True),), lights=(SUN,)), "hair")
    count = 20_000
    at, d, away = random.uniform(0.1, 1.4, count), random.normal(size=(count, 3)), random.normal(size=(count, 3))
    away[:, 2] = np.copysign(np.maximum(np.abs(away[:, 2]), np.hypot(away[:, 0], away[:, 1])), away[:, 2])
    d, away = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (d, away))
    o = np.column_stack([np.cos(at), np.sin(at), 0 * at]) + radius * random.uniform(-1, 1, (count, 3)) - 3 * d
    found = np.zeros((count, 2), bool)
    _transmit(Packed(made), new_stack(), *(each.astype(np.float32) for each in (o, d, away)), found)
    transmitted, occluded = found.sum(axis=0)
    assert transmitted > count / 10
    assert occluded < 0.01 * transmitted


@pytest.mark.parametrize("eye", [(0.0, 0.0, 6.0), (6.0, 0.0, 0.0), (4.0, 2.0, 4.0)])
def test_flat_curves_face_the_ray(eye: tuple[float, float, float]) -> None:
    """A diffuse one is as bright up to its edges as a plane through its axis that faces the viewer: it does not shadow itself."""
    along, albedo, radius = np.array((0.1, 1.0, 0.2)) / np.sqrt(1.05), 0.5, 0.3
    ribbon = Strand(np.linspace(-2, 2, 5)[:, None] * along, np.full(5, radius))
    mesh = replace(strands_mesh([ribbon], fibres=True), flat=True)
    across = np.cross(along, eye) / np.linalg.norm(np.cross(along, eye))
    for direction in ((-5.0, -1.0, -7.0), (-7.0, -3.0, 2.0)):
        made = scene([Material(base_color=gray(albedo))], (mesh,), lights=(Light("directional", (1, 1, 1), direction=direction),))
        assert variant_of(made) == "hair"
        for h in (-0.9, 0.0, 0.9):
            target = h * radius * across
            view = settings(eye, tuple(target), fov=0.4, size=8, max_depth=2)
            seen = mean(render_frame(made, view, 16), view.film_exponent)[..., 0]
            up = eye - target - along * ((eye - target) @ along)
            cosine = -up @ np.array(direction) / np.linalg.norm(up) / np.linalg.norm(direction)
            np.testing.assert_allclose(seen, max(cosine, 0) * albedo / np.pi, rtol=0.01)
        view = settings(eye, tuple(1.1 * radius * across), fov=0.4, size=8, max_depth=2)
        assert not mean(render_frame(made, view, 16), view.film_exponent).any()
