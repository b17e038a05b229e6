"""Tests that tangents point towards increasing u, for any UV layout and instance transform."""

from dataclasses import replace

import numpy as np
import pytest

from renderer.scene.description import Instance, Material, Mesh, SceneDescription, Texture
from renderer.scene.geometry import flatten
from renderer.scene.tangents import split_mirrored, vertex_tangents
from tests.renderer.scene.builders import rotation_y

UP = np.array([(0, 0, 1)] * 4, np.float32)
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], np.float32)
TWO = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
UPRIGHT = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)  # the image is upright, seen from +z


def bitangent(normal, tangent):
    return np.cross(normal, tangent[:, :3]) * tangent[:, 3:]


@pytest.mark.parametrize("turn", [0, 37, 90, 200])
@pytest.mark.parametrize("mirror", [1, -1])
def test_tangents_follow_the_image_axes(turn, mirror):
    """For rotated and mirrored images the tangent points towards increasing u, the bitangent towards decreasing v."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    uv = ((UPRIGHT * [mirror, 1]) @ np.array([[c, s], [-s, c]])).astype(np.float32)
    tangent = vertex_tangents(CORNERS, UP, uv, TWO)
    to_uv = np.linalg.lstsq(np.column_stack([CORNERS[:, :2], np.ones(4)]), uv, rcond=None)[0][:2]  # d(u, v) / d(x, y)
    right, up = np.linalg.inv(to_uv)[0], -np.linalg.inv(to_uv)[1]
    np.testing.assert_allclose(tangent[:, :2], np.tile(right / np.linalg.norm(right), (4, 1)), atol=1e-6)
    np.testing.assert_allclose(bitangent(UP, tangent)[:, :2], np.tile(up / np.linalg.norm(up), (4, 1)), atol=1e-6)
    assert (tangent[:, 3] == mirror).all()


def test_tangents_are_unit_and_perpendicular():
    rng = np.random.default_rng(0)
    normal = rng.standard_normal((50, 3))
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    triangle = rng.integers(0, 50, (80, 3)).astype(np.int32)
    for uv in (rng.random((50, 2)), np.zeros((50, 2))):  # the second UVs are constant
        tangent = vertex_tangents(rng.random((50, 3)).astype(np.float32), normal, uv.astype(np.float32), triangle)
        np.testing.assert_allclose(np.linalg.norm(tangent[:, :3], axis=1), 1, atol=1e-5)
        np.testing.assert_allclose((tangent[:, :3] * normal).sum(1), 0, atol=1e-5)
        assert set(np.unique(tangent[:, 3])) <= {-1.0, 1.0}


def test_vertices_at_a_mirror_seam_are_split():
    """Vertices at a mirror seam between a square's halves are split, since each half has its own tangent."""
    position = np.array([(-1, 0, 0), (0, 0, 0), (1, 0, 0), (-1, 1, 0), (0, 1, 0), (1, 1, 0)], np.float32)
    uv = np.array([(1, 1), (0, 1), (1, 1), (1, 0), (0, 0), (1, 0)], np.float32)
    triangle = np.array([(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)], np.int32)
    kept, split = split_mirrored(uv, triangle)
    assert sorted(kept.tolist()) == [0, 1, 1, 2, 3, 4, 4, 5]
    np.testing.assert_array_equal(position[kept][split], position[triangle])
    tangent = vertex_tangents(position[kept], np.tile(np.float32([0, 0, 1]), (8, 1)), uv[kept], split)
    np.testing.assert_array_equal(tangent[split[:2]].reshape(-1, 4), [(-1, 0, 0, -1)] * 6)
    np.testing.assert_array_equal(tangent[split[2:]].reshape(-1, 4), [(1, 0, 0, 1)] * 6)
    assert split_mirrored(UPRIGHT, TWO)[0].tolist() == [0, 1, 2, 3]


def bumpy(transform, **more):
    mesh = Mesh("square", CORNERS, TWO, UP, UPRIGHT, **more)
    return SceneDescription(
        meshes=[mesh], instances=[Instance(0, transform)], materials=[Material(normal_texture=0)], textures=[Texture(0)]
    )


@pytest.mark.parametrize("mirror", [1, -1])
def test_file_tangents_transform_like_computed_ones(mirror):
    transform = rotation_y(30) @ np.diag([mirror * 2.0, 3.0, 1.0, 1.0])
    given = flatten(bumpy(transform, tangents=np.array([(1, 0, 0, 1)] * 4, np.float32)))
    computed = flatten(bumpy(transform))
    np.testing.assert_allclose(given.tangent, computed.tangent, atol=1e-6)
    up = bitangent(given.normal, given.tangent)
    np.testing.assert_allclose(up, np.tile(transform[:3, 1] / np.linalg.norm(transform[:3, 1]), (4, 1)), atol=1e-6)


def test_tangents_are_computed_only_if_needed():
    description = bumpy(np.eye(4))
    description.materials.append(Material())
    description.instances.append(Instance(0, np.eye(4), material=1))
    tangent = flatten(description).tangent
    assert np.linalg.norm(tangent[:4], axis=1).min() > 0.5
    assert not tangent[4:].any()
    description.instances = description.instances[1:]
    assert flatten(description).tangent.shape == (0, 4)
    description.materials[1].anisotropy = 0.5
    assert flatten(description).tangent.shape == (4, 4)


def test_tangents_use_the_normal_maps_uv_set():
    description = bumpy(np.eye(4), uvs1=UPRIGHT[:, ::-1].copy())
    first = flatten(description).tangent
    description.textures[0] = replace(description.textures[0], uv_set=1)
    second = flatten(description).tangent
    np.testing.assert_allclose(first[0, :3], (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(second[0, :3], (0, -1, 0), atol=1e-6)
