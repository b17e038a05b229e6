"""Tests of the preview mesh: the scene's triangles in world space with their colours, decimated if there are many."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from protocol.mesh import Mesh as Packet
from protocol.mesh import decode_mesh, encode_mesh
from renderer.scene.description import Environment, Image, Instance, Light, Material, Mesh, SceneDescription, Sky, Sphere, Texture
from renderer.scene.preview import preview
from renderer.scene.studio import light_studio


def sheet(side: int) -> Mesh:
    """Returns a unit square of side x side cells in the plane z = 0."""
    x, y = np.meshgrid(np.linspace(0, 1, side + 1), np.linspace(0, 1, side + 1))
    positions = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float32)
    i, j = (each.ravel() for each in np.meshgrid(np.arange(side), np.arange(side)))
    a = j * (side + 1) + i
    triangles = np.concatenate([np.column_stack([a, a + 1, a + side + 1]), np.column_stack([a + 1, a + side + 2, a + side + 1])])
    normals = np.tile(np.float32([0, 0, 1]), (len(positions), 1))
    return Mesh("sheet", positions, triangles.astype(np.int32), normals, positions[:, :2].copy())


def scene(mesh: Mesh, *instances: Instance, material: Material | None = None) -> SceneDescription:
    return SceneDescription(meshes=[mesh], instances=list(instances) or [Instance(0)], materials=[material or Material()])


def test_preview_instances_and_normals() -> None:
    tilted = Mesh(
        "tilted",
        np.float32([[0, 0, 0], [1, 1, 0], [0, 0, 1]]),
        np.int32([[0, 1, 2]]),
        np.float32([[1, -1, 0]] * 3) / math.sqrt(2),
    )
    placed = np.diag([2.0, 1.0, 1.0, 1.0])
    placed[:3, 3] = 10, 20, 30
    found = preview(scene(tilted, Instance(0, placed), Instance(0)))
    assert found is not None
    np.testing.assert_allclose(found.positions[:3], [[10, 20, 30], [12, 21, 30], [10, 20, 31]])
    np.testing.assert_allclose(found.normals[0], np.array([1, -2, 0]) / math.sqrt(5), atol=1e-6)
    np.testing.assert_array_equal(found.triangles, [[0, 1, 2], [3, 4, 5]])


def test_decimation_preserves_the_area() -> None:
    found = preview(scene(sheet(300)), max_triangles=20_000)
    assert found is not None
    assert 5_000 < len(found.triangles) <= 20_000
    a, b, c = (found.positions[found.triangles[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert abs(area - 1) < 0.05
    assert found.positions.min() >= 0 and found.positions.max() <= 1


def test_preview_vertex_color_from_texture() -> None:
    pixels = np.zeros((1, 2, 4), np.uint8)
    pixels[0] = [[255, 0, 0, 255], [0, 128, 0, 255]]
    mesh = sheet(1)
    mesh.uvs = np.float32([[0.25, 0.5], [0.75, 0.5], [0.25, 0.5], [1.75, -0.5]])
    described = scene(mesh, material=Material(base_color=(1.0, 1.0, 1.0), base_color_texture=0))
    described.textures, described.images = [Texture(0)], [Image("two", pixels)]
    found = preview(described)
    assert found is not None
    assert found.colors[:4].tolist() == [[255, 0, 0, 255], [0, 128, 0, 255], [255, 0, 0, 255], [0, 128, 0, 255]]


def test_textured_triangles_are_subdivided() -> None:
    pixels = np.zeros((8, 8, 4), np.uint8)
    pixels[2:4, 4:6] = 255  # u from 1/2 to 3/4, v from 1/4 to 1/2: between the vertices
    described = scene(sheet(1), material=Material(base_color=(1.0, 1.0, 1.0), base_color_texture=0))
    described.textures, described.images = [Texture(0)], [Image("spot", pixels)]
    found = preview(described)
    assert found is not None
    np.testing.assert_array_equal(found.positions[:4], described.meshes[0].positions)
    np.testing.assert_array_equal(found.normals, np.tile([0, 0, 1], (len(found.positions), 1)))
    a, b, c = (found.positions[found.triangles[:, i]] for i in range(3))
    assert abs(np.cross(b - a, c - a)[:, 2].sum() / 2 - 1) < 1e-6  # the same area, the same side
    x, y, _ = found.positions.T
    inside = (x > 0.5) & (x < 0.75) & (y > 0.25) & (y < 0.5)
    assert inside.sum() > 100 and (found.colors[inside, 0] == 255).all()
    outside = (x < 0.5) | (x >= 0.75) | (y < 0.25) | (y >= 0.5)
    assert (found.colors[outside, 0] == 0).all()


def test_preview_of_emitters_and_interfaces() -> None:
    lamp = preview(scene(sheet(1), material=Material(emission=(5.0, 5.0, 5.0))))
    assert lamp is not None and lamp.colors.tolist() == [[255, 255, 255, 0]] * 4
    assert preview(scene(sheet(1), material=Material(kind="interface"))) is None
    assert preview(SceneDescription()) is None


def test_spheres_are_round() -> None:
    found = preview(SceneDescription(spheres=[Sphere((1.0, 2.0, 3.0), 0.5)], materials=[Material()]))
    assert found is not None
    np.testing.assert_allclose(np.linalg.norm(found.positions - [1, 2, 3], axis=1), 0.5)


def test_preview_mesh_packet_round_trip() -> None:
    """A mesh is restored from its packet: positions to 1/65535 of the bounds, also far from the origin; normals to 1/127."""
    random = np.random.default_rng(3)
    positions = 1e7 + random.uniform(-3, 3, (50, 3))
    positions[:, 2] = 4e6  # flat
    normals = random.normal(size=(50, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    colors = random.integers(0, 256, (50, 4), dtype=np.uint8)
    triangles = random.integers(0, 50, (20, 3), dtype=np.uint32)
    found = decode_mesh(encode_mesh(Packet(positions, normals, colors, triangles)))
    np.testing.assert_allclose(found.positions, positions, atol=6 / 65535)
    np.testing.assert_allclose(found.normals, normals, atol=0.5 / 127 + 1e-6)
    np.testing.assert_array_equal(found.colors, colors)
    np.testing.assert_array_equal(found.triangles, triangles)


def test_preview_background_is_the_worlds() -> None:
    """Black without a world, also of a model with lamps, the studio's None, a colour's own, and an image's around the horizon."""

    def background(light: Environment | None, image: Image | None = None) -> tuple[int, int, int] | None:
        lit = replace(scene(sheet(1)), environment=light, images=[image] if image else [])
        found = preview(lit)
        assert found is not None
        return found.background

    sky = np.zeros((8, 16, 3), np.float32)
    sky[2:6] = 0.25, 1.0, 4.0
    assert background(None) == (0, 0, 0)
    assert background(Environment((0.5, 1.0, 0.25), strength=0.5)) == (137, 188, 99)
    assert background(Environment(image=0, strength=2.0), Image("sky", sky, srgb=False)) == (188, 255, 255)
    assert background(Environment(sky=Sky())) is None
    studio = SceneDescription(meshes=[sheet(1)], instances=[Instance(0)], materials=[Material()])
    found = preview(replace(studio, studio_for_accents=True, lights=[Light("point")]))
    assert found is not None and found.background == (0, 0, 0), "a model with lamps is not lit by the studio"
    light_studio(studio)
    found = preview(studio)
    assert found is not None and found.background is None
    assert decode_mesh(encode_mesh(Packet(*found))).background is None
