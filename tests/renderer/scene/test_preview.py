"""Tests of the preview mesh: the scene's triangles in world space with their colours, decimated if there are many."""

from __future__ import annotations

import io
import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from protocol.mesh import decode_mesh, encode_mesh
from renderer.preview_mesh import NO_TEXTURE, PreviewLamp, PreviewMaterial, PreviewMesh, PreviewPart, PreviewTexture
from renderer.scene.description import Environment, Image, Instance, Light, Material, Mesh, SceneDescription, Sky, Sphere, Texture
from renderer.scene.preview import MOST_MATERIALS, preview
from renderer.scene.studio import light_studio, studio_image


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


def test_vertices_without_triangles_are_left_out() -> None:
    """Otherwise many instances of a mesh with millions of vertices and one triangle would take all memory."""
    mesh = Mesh("points", np.random.default_rng(1).random((100_000, 3), np.float32), np.int32([[7, 70_000, 9]]))
    found = preview(scene(mesh, *[Instance(0)] * 2_000))
    assert found is not None
    assert found.positions.shape == (6_000, 3)
    np.testing.assert_array_equal(found.positions[found.triangles[-1]], mesh.positions[mesh.triangles[0]])


@pytest.mark.long
def test_very_many_materials_become_few() -> None:
    described = scene(sheet(1), *(Instance(0, material=number) for number in range(3_000)))
    described.materials = [
        Material(kind="metallic_roughness", roughness=n / 3_000, base_color=(n / 3_000,) * 3) for n in range(3_000)
    ]
    found = preview(described)
    assert found is not None
    assert len(found.materials) == len(found.parts) == MOST_MATERIALS + 1
    assert len(np.unique(found.colors, axis=0)) > 200


@pytest.mark.long
def test_many_emitters_are_reduced_as_what_is_shown() -> None:
    """The power of 1,000 emitting meshes of 20,000 triangles is measured with their reduced shapes."""
    described = scene(sheet(100), *[Instance(0)] * 1_000, material=Material(emission=(1.0, 1.0, 1.0)))
    begun = time.process_time()
    found = preview(described)
    assert time.process_time() - begun < 2.5
    assert found is not None and found.lamps
    (single,) = strongest_of(scene(sheet(100), material=Material(emission=(1.0, 1.0, 1.0))))
    assert found.lamps[0].color == pytest.approx(single.color, rel=0.1)


def strongest_of(described: SceneDescription) -> tuple[PreviewLamp, ...]:
    found = preview(described)
    assert found is not None
    return found.lamps


def textured(pixels: np.ndarray, **more: Any) -> SceneDescription:
    described = scene(sheet(1), material=Material(base_color=(1.0, 1.0, 1.0), base_color_texture=0, **more))
    described.textures, described.images = [Texture(0, "clamp", transform=(2.0, 0, 0.5, 0, 1, 0))], [Image("picture", pixels)]
    return described


def opened(texture: PreviewTexture) -> np.ndarray:
    with Pillow.open(io.BytesIO(texture.data)) as picture:
        assert picture.get_format_mimetype() == texture.type
        return np.asarray(picture).astype(int)


def test_textures_are_reduced_and_their_uvs_transformed() -> None:
    pixels = np.full((2048, 4096, 4), 255, np.uint8)
    pixels[:, 2048:, :3] = [0, 128, 0]
    found = preview(textured(pixels))
    assert found is not None and found.uvs is not None
    assert found.colors.tolist() == [[255] * 4] * 4
    np.testing.assert_allclose(found.uvs, found.positions[:, :2] * [2, 1] + [0.5, 0])
    (texture,) = found.textures
    assert (texture.type, texture.wrap_s, texture.wrap_t) == ("image/jpeg", "clamp", "repeat")
    shown = opened(texture)
    assert shown.shape == (512, 1024, 3)
    np.testing.assert_allclose(shown[:, ::1023], np.tile([[255, 255, 255], [0, 128, 0]], (512, 1, 1)), atol=4)


@pytest.mark.parametrize("kind", ["transparent", "linear", "hdr", "16 bit"])
def test_textures_keep_their_colors(kind: str) -> None:
    """Also those of pixels that are transparent, which opaque materials show."""
    linear = np.float32([[[0.5, 0.25, 0.75, 1.0]] * 8] * 8)
    coded = np.float32([0.735, 0.537, 0.881, 1.0])
    pixels = {
        "transparent": np.tile(np.rint(255 * coded * [1, 1, 1, 0]).astype(np.uint8), (8, 8, 1)),
        "linear": np.rint(255 * linear).astype(np.uint8),
        "hdr": linear,
        "16 bit": np.tile(np.rint(65535 * coded).astype(np.uint16), (8, 8, 1)),
    }[kind]
    described = textured(pixels)
    described.images[0].srgb = kind != "linear"
    found = preview(described)
    assert found is not None
    shown = opened(found.textures[0])
    np.testing.assert_allclose(shown[..., :3], np.broadcast_to(255 * coded[:3], (8, 8, 3)), atol=4)
    assert shown.shape[2] == (4 if kind == "transparent" else 3)


def test_many_textures_are_reduced_more() -> None:
    described = textured(np.zeros((1024, 1024, 4), np.uint8))
    count = 64
    described.images *= count
    described.textures = [Texture(i) for i in range(count)]
    described.materials = [replace(described.materials[0], base_color_texture=i) for i in range(count)]
    described.instances = [Instance(0, material=i) for i in range(count)]
    found = preview(described)
    assert found is not None and len(found.textures) == count
    assert opened(found.textures[0]).shape[:2] == (512, 512)


def test_preview_materials_are_those_of_the_path_tracer() -> None:
    def shown(material: Material) -> PreviewMaterial:
        found = preview(scene(sheet(1), material=material))
        assert found is not None
        return found.materials[0]

    assert shown(Material(kind="diffuse")) == PreviewMaterial()
    mirror, glass = shown(Material(kind="mirror")), shown(Material(kind="glass", ior=1.5, thin=True))
    assert (mirror.metallic, mirror.roughness) == (1.0, 0.0)
    assert (glass.transmission, glass.roughness, glass.thin) == (1.0, 0.0, True)
    np.testing.assert_allclose(glass.f0, 0.04)
    coated = shown(Material(kind="metallic_roughness", metallic=0.25, roughness=0.5, clearcoat=1.0, specular=0.5))
    assert (coated.metallic, coated.roughness, coated.coat) == (0.25, 0.5, 1.0)
    np.testing.assert_allclose(coated.f0, 0.02)
    gold = preview(scene(sheet(1), material=Material(kind="conductor", eta=(0.14, 0.37, 1.44), k=(3.98, 2.38, 1.6))))
    assert gold is not None and gold.colors[0, 0] > gold.colors[0, 1] > gold.colors[0, 2], "gold is yellow"
    lamp = preview(scene(sheet(1), material=Material(emission=(5.0, 6.0, 7.0))))
    assert lamp is not None and lamp.materials[0].emission == (5.0, 6.0, 7.0)
    wax = Material(kind="glass", sigma_s=(50.0, 50.0, 50.0))
    ball = preview(SceneDescription(spheres=[Sphere((0.0, 0.0, 0.0), 1.0)], materials=[wax]))
    assert ball is not None and ball.materials[0].transmission == 0.0, "nothing is seen through it"
    assert preview(scene(sheet(1), material=Material(kind="interface"))) is None
    assert preview(SceneDescription()) is None


def test_textures_with_other_uvs_are_replaced_by_their_mean() -> None:
    """A preview has one set of UVs."""
    packed = np.zeros((4, 4, 4), np.uint8)
    packed[..., 1], packed[..., 2] = 102, 255
    material = {"kind": "metallic_roughness", "metallic": 1.0, "roughness": 0.5, "metallic_roughness_texture": 1}
    described = textured(np.full((4, 4, 4), 255, np.uint8), **material)
    described.images.append(Image("packed", packed, srgb=False))
    described.textures.append(Texture(1, transform=described.textures[0].transform))
    same = preview(described)
    assert same is not None and same.materials[0].metallic_roughness_texture == 1
    assert same.materials[0].roughness == 0.5
    described.textures[1] = Texture(1)
    other = preview(described)
    assert other is not None and other.materials[0].metallic_roughness_texture == NO_TEXTURE
    assert other.materials[0].roughness == pytest.approx(0.2)


def test_parts_have_their_triangles() -> None:
    described = scene(sheet(2), Instance(0, material=0), Instance(0, material=1), Instance(0, material=2))
    rough = Material(kind="metallic_roughness", roughness=0.5)
    described.materials = [rough, Material(kind="mirror"), replace(rough, base_color=(1.0, 0.0, 0.0))]
    found = preview(described)
    assert found is not None
    assert [part[:2] for part in found.parts] == [(0, 48), (48, 24)], "materials that differ only in colour are one"
    assert found.materials[found.parts[1].material].metallic == 1.0
    assert {tuple(row) for row in found.colors[found.triangles[8:16]].reshape(-1, 4).tolist()} == {(255, 0, 0, 255)}


def test_lamps_give_the_light_of_their_bodies() -> None:
    """At a distance, a square lamp below a surface, a ball and a point light of the same intensity are as bright."""
    square = sheet(1)
    away = np.eye(4)
    away[:3, 3] = -0.5, -0.5, -10.0
    material = Material(emission=(3.0, 3.0, 3.0))
    ball = SceneDescription(
        meshes=[sheet(1)], instances=[Instance(0)], materials=[Material(), material],
        spheres=[Sphere((0.5, 0.5, 10.0), math.sqrt(1 / math.pi), 1)],
    )  # fmt: skip
    flat = replace(ball, meshes=[sheet(1), replace(square, material=1)], instances=[Instance(0), Instance(1, away)], spheres=[])
    point = replace(flat, instances=[Instance(0)], lights=[Light("point", (3.0, 3.0, 3.0), (0.5, 0.5, 10.0))])

    def irradiance(description: SceneDescription) -> tuple[PreviewLamp, float]:
        found = preview(description)
        assert found is not None
        (lamp,) = found.lamps
        middle = (found.positions.min(axis=0) + found.positions.max(axis=0)) / 2
        return lamp, lamp.color[0] * float(np.sum((np.array(lamp.at) - middle) ** 2)) * math.pi

    assert irradiance(ball)[1] == pytest.approx(3.0, rel=0.01)
    assert irradiance(point)[1] == pytest.approx(3.0)
    lamp, intensity = irradiance(flat)
    assert intensity == pytest.approx(3.0, rel=0.01)
    np.testing.assert_allclose([lamp.axis, (*lamp.cosines, 0)], [[0, 0, 1], [0, 1, 0]], atol=1e-6)


def test_spheres_are_round() -> None:
    found = preview(SceneDescription(spheres=[Sphere((1.0, 2.0, 3.0), 0.5)], materials=[Material()]))
    assert found is not None
    np.testing.assert_allclose(np.linalg.norm(found.positions - [1, 2, 3], axis=1), 0.5)


def test_many_spheres_are_bounded_and_large_ones_remain_round() -> None:
    small = [Sphere((float(i), 0.0, 0.0), 0.01) for i in range(500)]
    materials = [Material(), Material(base_color=(0.5, 0.0, 0.0))]
    found = preview(SceneDescription(spheres=[Sphere((0.0, 5.0, 0.0), 1.0, 1), *small], materials=materials), 300_000)
    assert found is not None
    assert len(found.triangles) < 0.35 * 300_000
    large = np.abs(found.positions[:, 1]) > 1.0
    corners = found.positions[found.triangles[large[found.triangles].all(axis=1)]]
    middles = corners.mean(axis=1) - (0.0, 5.0, 0.0)
    assert np.linalg.norm(middles, axis=1).min() > 0.99


def test_preview_mesh_packet_round_trip() -> None:
    """A mesh is restored from its packet: positions to 1/65535 of the bounds, also far from the origin; normals to 1/127."""
    random = np.random.default_rng(3)
    positions = 1e7 + random.uniform(-3, 3, (50, 3))
    positions[:, 2] = 4e6  # flat
    normals = random.normal(size=(50, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    colors = random.integers(0, 256, (50, 4), dtype=np.uint8)
    triangles = random.integers(0, 50, (20, 3), dtype=np.uint32)
    more = {
        "uvs": random.normal(size=(50, 2)).astype(np.float32),
        "parts": (PreviewPart(0, 30, 1), PreviewPart(30, 30, 0)),
        "materials": (PreviewMaterial(), PreviewMaterial(metallic=1.0, f0=(0.1, 0.2, 0.3), texture=0)),
        "textures": (PreviewTexture(b"file", "image/webp", "clamp"), PreviewTexture(b"other", "image/jpeg", nearest=True)),
        "lamps": (PreviewLamp((1.0, 2.0, 3.0), False, (4.0, 5.0, 6.0), (0.0, -1.0, 0.0), (0.0, 1.0)),),
        "studio": True,
    }
    packet = encode_mesh(PreviewMesh(positions, normals, colors, triangles, environment=studio_image(), **more))
    found = decode_mesh(packet)
    np.testing.assert_allclose(found.positions, positions, atol=6 / 65535)
    np.testing.assert_allclose(found.normals, normals, atol=0.5 / 127 + 1e-6)
    np.testing.assert_array_equal(found.colors, colors)
    np.testing.assert_array_equal(found.triangles, triangles)
    assert found.environment is not None and found.uvs is not None
    np.testing.assert_allclose(found.environment, studio_image(), rtol=0.005)
    np.testing.assert_array_equal(found.uvs, more.pop("uvs"))
    assert {name: getattr(found, name) for name in more} == more
    for length in (10, len(packet) - 1):
        with pytest.raises(ValueError, match=r"bytes|cut off"):
            decode_mesh(packet[:length])


def test_preview_light_is_the_worlds() -> None:
    """None without a world, the studio's, a colour, an image, turned, and a sky with its sun."""

    def shown(light: Environment | None, image: Image | None = None) -> PreviewMesh:
        lit = replace(scene(sheet(1)), environment=light, images=[image] if image else [])
        found = preview(lit)
        assert found is not None
        return found

    assert shown(None).environment is None
    color = shown(Environment((0.5, 1.0, 0.25), strength=0.5)).environment
    np.testing.assert_allclose(color, [[[0.25, 0.5, 0.125]]])
    pixels = np.zeros((128, 256, 3), np.float32)
    pixels[30:32, 128:130] = 8.0  # towards -Z, in the middle
    turned = shown(Environment(image=0, strength=2.0, rotation=90.0), Image("lamp", pixels, srgb=False)).environment
    assert turned is not None and turned.shape == (64, 128, 3)
    np.testing.assert_allclose(turned[15, 32], 16.0)  # towards -X
    assert np.count_nonzero(turned[..., 0]) == 1
    sky = shown(Environment(sky=Sky(sun_elevation=30.0)))
    assert sky.environment is not None and sky.environment[:20].min() > 0
    assert len(sky.lamps) == 1 and sky.lamps[0].far
    np.testing.assert_allclose(sky.lamps[0].at, [0, 0.5, -math.sqrt(0.75)], atol=1e-6)
    studio = SceneDescription(meshes=[sheet(1)], instances=[Instance(0)], materials=[Material()])
    found = preview(replace(studio, studio_for_accents=True, lights=[Light("point")]))
    assert found is not None and found.environment is None, "a model with lamps is not lit by the studio"
    for emission, is_studio in ((0.01, True), (50.0, False)):
        shining = replace(studio, studio_for_accents=True, materials=[Material(emission=(emission,) * 3)])
        found = preview(shining)
        assert found is not None and found.studio == is_studio, "unless its surfaces shine more than accents do"
    light_studio(studio)
    found = preview(studio)
    assert found is not None and found.studio and found.environment is not None
    np.testing.assert_allclose(found.environment, studio_image(), rtol=1e-6)
