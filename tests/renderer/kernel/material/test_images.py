"""Tests of texture lookups for eight lanes against single lookups, which test_texture.py tests."""

import numpy as np
import pytest

from renderer.jit import entry
from renderer.kernel.fetch import row
from renderer.kernel.material.images import image_colors
from renderer.kernel.material.texture import sample_texture
from renderer.scene.compile import compile_scene
from renderer.scene.description import Image, Instance, Material, Mesh, SceneDescription, Texture
from renderer.wide.rows import load_ints
from renderer.wide.values import as_ints
from tests.renderer.wide.both import keep

COUNT = 4000


@entry
def _look_up(scene, given, order, eight, one):
    for i in range(0, len(given), 8):
        number = load_ints(order, np.uintp(i))
        texture, u, v, u1, v1 = row(given, number, 5)
        keep(eight, i, number, image_colors(scene, as_ints(texture), (u, v), (u1, v1)))
    for i in range(len(given)):
        texture, u, v, u1, v1 = row(given, i, 5)
        r, g, b, _ = sample_texture(scene, np.int64(np.int32(as_ints(texture))), (u, v), (u1, v1), None)
        keep(one, i, i, (r, g, b))


@pytest.mark.long
def test_eight_lane_lookup_equals_single_lookups():
    rng = np.random.default_rng(2)
    images = [
        Image("a", rng.integers(0, 256, (5, 4, 4), np.uint8)),
        Image("b", rng.integers(0, 256, (3, 6, 4), np.uint8), srgb=False),
    ]
    modes = "repeat", "mirror", "clamp"
    textures = [
        Texture(
            i % 2,
            modes[i % 3],
            modes[(i // 3) % 3],
            transform=(2.0, 0.5, 0.1, -0.25, 1.5, -0.3),
            uv_set=i % 2,
            filter="nearest" if i >= 9 else "linear",
        )
        for i in range(18)
    ]
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0)], np.float32)
    mesh = Mesh("corner", corners, np.array([[0, 1, 2]], np.int32), uvs=corners[:, :2], uvs1=corners[:, 1:])
    materials = [Material(base_color_texture=i) for i in range(len(textures))]
    scene = compile_scene(
        SceneDescription(meshes=[mesh], instances=[Instance(0)], materials=materials, textures=textures, images=images)
    )
    given = rng.uniform(-40, 40, (COUNT, 5)).astype(np.float32)
    given[::3, 1:] /= 20
    given[:4, 1], given[4:8, 2] = (np.nan, np.inf, 1e30, -1e7), (1e7, -np.inf, np.nan, 0)
    given[:, 0] = scene.material_texture[rng.integers(0, len(textures), COUNT), 0].view(np.float32)
    eight, one = np.zeros((2, 3, COUNT), np.float32)
    _look_up(scene, given, np.arange(COUNT, dtype=np.int32), eight, one)
    apart = abs(eight - one).max(axis=0)
    assert np.mean(apart < 2e-4) > 0.999  # from the last bit of coordinates hundreds of texels away; a few hit another texel
    assert np.median(apart) < 1e-6
