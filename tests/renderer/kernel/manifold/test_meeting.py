"""Tests of light that a caster's bright spots send on to other surfaces, against light traced from the lamp with NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.arrays.scene import CompiledScene
from renderer.scene.description import Light, Material, Sphere
from tests.renderer.builders import gray, scene, settings, square
from tests.renderer.kernel.manifold.test_caustics import FLOOR, GLASS, MATT, MIRROR, POINT, SUN, WATER, assert_mean, pixels

PATCH = np.array([0.9, -0.6, 0.0])  # seen from below: only the floor lights it
HALF = 0.1  # of the patch's side
ALBEDO = 0.5
RADIUS = 0.5  # of the ball about the origin
CONE = 14.0  # degrees; the ball fills 14.5 of them
SPOT = Light("spot", intensity=gray(10.0), position=(0.0, 2.0, 0.0), inner_cone=CONE, outer_cone=CONE, falloff="linear")
WALL = 1.5  # x of the mirror, which the patch does not see
Rays = tuple[np.ndarray, np.ndarray, np.ndarray]  # origins, directions, fluxes


def room(caster: str, light: Light) -> CompiledScene:
    """Returns a floor, a caster above it, and a matt patch that faces the floor."""
    patch = square(tuple(PATCH), (HALF, 0, 0), (0, 0, HALF), 0)
    casters = {"water": (WATER,), "ball": (), "mirror": (square((WALL, 0.4, 0), (0, 1, 0), (0, 0, 2), 1),)}[caster]
    ball = (Sphere((0, 0, 0), RADIUS, 1),) if caster == "ball" else ()
    materials: list[Material] = [MATT, MIRROR if caster == "mirror" else GLASS]
    return scene(materials, (FLOOR, patch, *casters), ball, lights=(light,))


def emitted(light: Light, count: int) -> Rays:
    """Returns rays downwards that share the light's flux, or its irradiance on a square of 7 x 7."""
    k = np.arange(count)
    u, v = k * 0.7548776662466927 % 1, k * 0.5698402909980532 % 1  # evenly spread: Roberts, "The R2 sequence" (2018)
    if light.kind == "directional":
        start = np.stack([7 * u - 3.5, np.full(count, 3.0), 7 * v - 3.5], 1)
        return start, np.tile([0.0, -1.0, 0.0], (count, 1)), np.full(count, 3.0 * 49 / count)
    width = 1 - np.cos(np.radians(CONE)) if light.kind == "spot" else 0.7  # to 9 on the floor, beyond its corners
    down = 1 - width * u
    side = np.sqrt(1 - down * down)
    d = np.stack([side * np.cos(2 * np.pi * v), -down, side * np.sin(2 * np.pi * v)], 1)
    return np.tile([0.0, 2.0, 0.0], (count, 1)), d, np.full(count, 10 * 2 * np.pi * width / count)


def reflectance(cosine: np.ndarray, eta: float) -> np.ndarray:
    inner = np.sqrt(1 - (1 - cosine**2) / eta**2)
    along, across = (eta * cosine - inner) / (eta * cosine + inner), (cosine - eta * inner) / (cosine + eta * inner)
    return (along**2 + across**2) / 2


def refracted(d: np.ndarray, n: np.ndarray, eta: float) -> np.ndarray:
    cosine = -(d * n).sum(1)
    return d / eta + n * (cosine / eta - np.sqrt(1 - (1 - cosine**2) / eta**2))[:, None]


def after_caster(caster: str, rays: Rays) -> list[Rays]:
    """Returns the rays below the caster: refracted, reflected, and those that miss it."""
    o, d, flux = rays
    if caster == "water":
        p = o - d * (o[:, 1] / d[:, 1])[:, None]
        hits = (np.abs(p[:, [0, 2]]) < 2).all(1)
        up = np.tile([0.0, 1.0, 0.0], (hits.sum(), 1))
        left = flux[hits] * (1 - reflectance(-d[hits, 1], 1.33))
        return [(p[hits], refracted(d[hits], up, 1.33), left), (o[~hits], d[~hits], flux[~hits])]
    if caster == "mirror":
        p = o + d * ((WALL - o[:, 0]) / np.maximum(d[:, 0], 1e-9))[:, None]
        hits = (d[:, 0] > 0) & (np.abs(p[:, 1] - 0.4) < 1) & (np.abs(p[:, 2]) < 2)
        return [(p[hits], d[hits] * (-1, 1, 1), 0.8 * flux[hits]), (o[~hits], d[~hits], flux[~hits])]
    along = (o * d).sum(1)
    square_root = along**2 - (o * o).sum(1) + RADIUS**2
    hits = square_root > 0
    misses = o[~hits], d[~hits], flux[~hits]
    o, d, flux = o[hits], d[hits], flux[hits]
    p = o - d * (along[hits] + np.sqrt(square_root[hits]))[:, None]
    n = p / RADIUS
    cosine = -(d * n).sum(1)
    bounced = d + 2 * n * cosine[:, None]
    lost = reflectance(cosine, 1.33)
    inner = refracted(d, n, 1.33)
    q = p - inner * (2 * (p * inner).sum(1))[:, None]
    return [(q, refracted(inner, -q / RADIUS, 1 / 1.33), flux * (1 - lost) ** 2), (p, bounced, lost * flux), misses]


def sent_on(caster: str, light: Light) -> float:
    """Returns the radiance of the patch's centre."""
    total = 0.0
    for o, d, flux in after_caster(caster, emitted(light, 1 << 21)):
        at_patch = o + d * ((PATCH[1] - o[:, 1]) / np.minimum(d[:, 1], -1e-9))[:, None]
        floor = o + d * ((-1 - o[:, 1]) / np.minimum(d[:, 1], -1e-9))[:, None]
        arrives = (d[:, 1] < 0) & (np.abs(floor[:, [0, 2]]) < 3).all(1)
        arrives &= ~(np.abs(at_patch - PATCH)[:, [0, 2]] < HALF).all(1)
        way = PATCH - floor[arrives]
        square_length = (way * way).sum(1)
        total += (flux[arrives] * way[:, 1] ** 2 / square_length**2).sum()
    return total * (ALBEDO / np.pi) ** 2


@pytest.mark.long
@pytest.mark.parametrize(
    ("caster", "light"),
    [("water", POINT), ("water", SUN), ("ball", SPOT), ("ball", SUN), ("mirror", POINT)],
    ids=["water", "water-sun", "ball", "ball-sun", "mirror"],
)
def test_light_that_bright_spots_send_on_matches_traced_light(caster: str, light: Light) -> None:
    """No lamp can be hit, so walks and photons alone find its light. The spot lights nothing but the ball."""
    eye = tuple(PATCH - (0.0, 0.3, 0.0))
    asked = settings(eye, tuple(PATCH), fov=0.1, size=8, max_depth=4, caustics="on")
    assert MATT.base_color == gray(ALBEDO)
    assert_mean(pixels(room(caster, light), asked, 512).reshape(-1), sent_on(caster, light))
