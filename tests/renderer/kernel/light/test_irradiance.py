"""Tests of light sampling against brute force, in which uniformly distributed directions hit a light by chance.

Unlike tests of densities, they also cover textures, sides and occluders, and that lights that are never chosen illuminate
nothing.
"""

import math

import numpy as np
import pytest

from renderer.bvh.traverse import NO_PRIMITIVE, any_hit, closest_hit, new_stack
from renderer.jit import entry
from renderer.kernel import vec
from renderer.kernel.light.environment import environment_radiance
from renderer.kernel.light.lights import sample_light
from renderer.kernel.material.material import emission, opacity
from renderer.kernel.sampling.warp import square_to_sphere
from renderer.kernel.surface.surface import surface_at
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Image, Instance, Material, SceneDescription, Sky, Sphere, Texture
from renderer.scene.environment import environment_sampled_fully
from tests.renderer.builders import as_rendered, disk, gray, icosphere, square
from tests.renderer.judge import limit

N = 400_000
_FOUR_PI = np.float32(4 * math.pi)


@entry
def _sample_lights(made, stack, p, n, u, out):
    o, normal = (p[0], p[1], p[2]), (n[0], n[1], n[2])
    for i in range(len(u)):
        light = sample_light(made, o, normal, u[i, 0], (u[i, 1], u[i, 2]), None)
        cosine = vec.dot(light.direction, normal)
        if not (light.pdf > np.float32(0.0) and cosine > np.float32(0.0)):
            continue
        if not any_hit(made.bvh, stack, o, vec.sub(light.end, o), np.float32(1.0), None):
            out[i] = vec.luminance(light.radiance) * cosine / light.pdf


@entry
def _brute_force(made, stack, p, n, u, out):
    o, normal = (p[0], p[1], p[2]), (n[0], n[1], n[2])
    for i in range(len(u)):
        d = square_to_sphere((u[i, 0], u[i, 1]))
        cosine = vec.dot(d, normal)
        if cosine > np.float32(0.0):
            hit = closest_hit(made.bvh, stack, o, d, np.float32(np.inf), None)
            if hit.primitive == NO_PRIMITIVE:
                radiance = environment_radiance(made.environment, made.environment_frame, d)
            else:
                surface = surface_at(made, o, d, hit)
                alpha = opacity(made, surface.material, surface.uv, surface.uv1, surface.color[3], None)
                radiance = vec.scale(emission(made, surface.material, surface.uv, surface.uv1, surface.front, None), alpha)
            out[i] = vec.luminance(radiance) * cosine * _FOUR_PI


def _uvs(mesh):
    low, high = mesh.positions.min(0), mesh.positions.max(0)
    wide = np.argsort(high - low)[-2:]
    mesh.uvs = ((mesh.positions - low)[:, wide] / (high - low)[wide]).astype(np.float32)
    return mesh


def lit_by(*meshes, spheres=(), environment=None, double_sided=False, opacity=1.0, plain=False):
    """Returns a scene with emitters of material 0, textured unless `plain`; material 1 is a black occluder."""
    codes = np.random.default_rng(5).integers(0, 256, (8, 8, 4)).astype(np.uint8)
    shining = Material(base_color=gray(0), emission=(3.0, 2.0, 1.0), emission_texture=0, double_sided=double_sided)
    if plain:
        shining.emission_texture = None
    if opacity < 1:
        shining.opacity, shining.alpha_mode = opacity, "blend"
    made = compile_scene(
        SceneDescription(
            meshes=[_uvs(mesh) for mesh in meshes],
            instances=[Instance(i) for i in range(len(meshes))],
            spheres=list(spheres),
            materials=[shining, Material(base_color=gray(0))],
            textures=[Texture(0, "clamp", "mirror")],
            images=[Image("texels", codes)],
            environment=environment,
        )
    )
    return as_rendered(environment_sampled_fully(made))


def _faded(mesh):
    """Returns the mesh with vertex alpha decreasing from vertex to vertex."""
    mesh.colors = np.ones((len(mesh.positions), 4), np.float32)
    mesh.colors[:, 3] = np.linspace(1, 0, len(mesh.positions))
    return mesh


BLOCKER = ((0.3, 0.5, 0.0), (0.3, 0, 0), (0, 0, 0.3))
SCENES = {
    "square": lambda: lit_by(square((0.2, 1, 0), (0.8, 0, 0), (0, 0, 0.5), 0), square(*BLOCKER, 1)),
    "square from behind": lambda: lit_by(square((0.2, 1, 0), (0.8, 0, 0), (0, 0.1, -0.5), 0), double_sided=True),
    "lamp": lambda: lit_by(square((0.2, 0.4, 0), (0.8, 0, 0), (0, 0, 0.5), 0), square(*BLOCKER, 1), plain=True),
    "lamp cut by the horizon": lambda: lit_by(
        square((0.7, 0.1, 0.1), (0, 0.4, 0), (0.1, 0.2, 0.6), 0), double_sided=True, plain=True
    ),
    "disk": lambda: lit_by(disk(0.9, 1.2, 24, 0), square(*BLOCKER, 1)),
    "sphere": lambda: lit_by(square(*BLOCKER, 1), spheres=(Sphere((0.4, 1.1, 0.2), 0.6, 0),)),
    "sphere cut by the horizon": lambda: lit_by(spheres=(Sphere((1.4, 0.2, 0.2), 0.6, 0),)),
    "veil of light": lambda: lit_by(_faded(square((0.2, 1, 0), (0.8, 0, 0), (0, 0, 0.5), 0)), opacity=0.4),
    "inside a sphere": lambda: lit_by(spheres=(Sphere((0.3, 0.1, 0.2), 1.6, 0),), double_sided=True),
    "mesh": lambda: lit_by(icosphere(2, 0, 0.7, (-0.5, 1.0, 0.3)), square(*BLOCKER, 1)),
    "all": lambda: lit_by(
        icosphere(1, 0, 0.3, (-0.8, 0.7, 0.3)),
        disk(0.4, 2.0, 12, 0),
        square((1.2, 0.3, 0), (0, 0.5, 0), (0, 0, 0.5), 0),
        spheres=(Sphere((0.4, 1.1, -1.2), 0.4, 0), Sphere((0.2, 0.1, 0.9), 0.2, 0)),
        environment=Environment(sky=Sky(40.0, 30.0, sun_size=20.0), rotation=20.0),
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_light_sampling_mean_equals_brute_force(name):
    made = SCENES[name]()
    p, n = np.zeros(3, np.float32), np.array([0, 1, 0], np.float32)
    u = np.random.default_rng(6).random((2, N, 3), np.float32)
    lights, chance = np.zeros(N, np.float32), np.zeros(N, np.float32)
    _sample_lights(made, new_stack(), p, n, u[0], lights)
    _brute_force(made, new_stack(), p, n, u[1], chance)
    errors = [x.astype(float).std() / math.sqrt(N) for x in (lights, chance)]
    means = [x.astype(float).mean() for x in (lights, chance)]
    assert errors[1] < 0.03 * means[1]
    assert errors[0] < errors[1]
    assert abs(means[0] - means[1]) < limit(len(SCENES)) * math.hypot(*errors), (means, errors)
