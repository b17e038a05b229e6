"""Tests of normal maps: decoded in the tangent frame, and limited so that the viewer never sees a black surface."""

import numpy as np
import pytest

from renderer.jit import entry, subroutine
from renderer.kernel import vec
from renderer.kernel.material.normal_map import map_normal, shading_frame
from renderer.reference import Packed, by_reference
from renderer.scene.compile import compile_scene
from renderer.scene.description import Image, Instance, Material, SceneDescription, Texture
from tests.renderer.builders import as_rendered, square
from tests.renderer.kernel.subject import facing_up, hemisphere

ZERO, ONE = np.float32(0), np.float32(1)
UP = (ZERO, ZERO, ONE)


@entry
def _map(color, wo, out):
    for i in range(len(color)):
        s, t, n = (ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE)
        texel = (color[i, 0], color[i, 1], color[i, 2])
        out[i, 0], out[i, 1], out[i, 2] = map_normal(texel, ONE, s, t, n, n, (wo[i, 0], wo[i, 1], wo[i, 2]))


@subroutine
def _write_frame(scene, surface, wo, out):
    s, t, n = shading_frame(scene, surface, wo, None)
    for k in range(3):
        out[0, k] = s[k]
        out[1, k] = t[k]
        out[2, k] = n[k]
    out[3, 0] = vec.dot(vec.cross(s, t), n)


@entry
def _frame(scene, surface, wo, out):
    _write_frame(by_reference(scene), surface, wo, out)


def frame(rgb, front=True, scale=1.0, sign=1.0):
    """Returns the frame (s, t, n) on a square facing up, with the tangent along x, under a normal map of one colour."""
    mesh = square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0)
    mesh.uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    image = Image("n", np.array([[[*rgb, 255]]], np.uint8), srgb=False)
    material = Material(normal_texture=0, normal_scale=scale)
    description = SceneDescription(meshes=[mesh], instances=[Instance(0)], materials=[material], images=[image])
    description.textures = [Texture(0)]
    up = UP if front else (ZERO, ZERO, -ONE)
    surface = facing_up(geometric=up, shading=up, front=front, tangent=(ONE, ZERO, ZERO, np.float32(sign)))
    out = np.zeros((4, 3), np.float32)
    _frame(Packed(as_rendered(compile_scene(description))), surface, up, out)
    np.testing.assert_allclose(out[:3] @ out[:3].T, np.eye(3), atol=1e-5)
    return out


def test_flat_normal_map_has_no_effect():
    np.testing.assert_allclose(frame((128, 128, 255))[2], (0, 0, 1), atol=0.006)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_red_tilts_along_the_tangent_and_green_along_the_bitangent(sign):
    tilted = frame((218, 128, 218), sign=sign)[2]
    np.testing.assert_allclose(tilted, (0.707, 0, 0.707), atol=0.01)
    tilted = frame((128, 218, 218), sign=sign)[2]
    np.testing.assert_allclose(tilted, (0, sign * 0.707, 0.707), atol=0.01)


def test_normal_map_is_inverted_from_behind():
    np.testing.assert_allclose(frame((218, 128, 218), front=False)[2], (-0.707, 0, -0.707), atol=0.01)
    np.testing.assert_allclose(frame((128, 218, 218), front=False)[2], (0, -0.707, -0.707), atol=0.01)


def test_normal_scale_flattens():
    np.testing.assert_allclose(frame((218, 128, 218), scale=0.5)[2], np.array((0.5, 0, 1)) / np.sqrt(1.25), atol=0.01)


def test_mapped_normals_reflect_above_the_surface():
    n = 20_000
    rng = np.random.default_rng(1)
    color, wo = rng.random((n, 3), np.float32), hemisphere(n, 2)
    found = np.empty((n, 3), np.float32)
    _map(color, wo, found)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-5)
    facing = (found * wo).sum(1)
    assert (facing > 0).all()
    mirrored = 2 * facing * found[:, 2] - wo[:, 2]
    assert (mirrored > np.minimum(0.9 * wo[:, 2], 0.01) - 1e-4).all()


def test_consistent_normals_are_unchanged():
    n = 2000
    wo = np.tile(np.float32((0, 0, 1)), (n, 1))
    normal = hemisphere(n, 3)
    normal = normal[normal[:, 2] > 0.8]
    found = np.empty_like(normal)
    _map((normal + 1) / 2, wo[: len(normal)], found)
    np.testing.assert_allclose(found, normal, atol=1e-5)
