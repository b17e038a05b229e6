"""Tests of glTF files: all forms of arrays, hierarchy and materials."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from renderer.errors import SceneError
from tests.renderer.scene.builders import TRIANGLE, Gltf, world

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], np.float32)


@pytest.mark.parametrize("digits", [400, 5000])
def test_number_beyond_float_range_is_an_error(scene, digits):
    g = Gltf()
    g.mesh()
    g.node(translation=[1, 2, 12345])
    warnings = scene("a.gltf", g.gltf().replace(b"12345", b"1" * digits)).warnings
    assert any("is not a list of 3 numbers" in warning and "nodes[1].translation" in warning for warning in warnings)


def test_embedded_external_and_data_uri_buffers(scene):
    g = Gltf()
    g.mesh(SQUARE, np.array([0, 1, 2, 0, 2, 3], np.uint16))
    inside = world(scene("a.glb", g.glb()))
    np.testing.assert_array_equal(world(scene("b.gltf", g.gltf())), inside)
    np.testing.assert_array_equal(world(scene("c.gltf", g.gltf("my%20data.bin"), {"my data.bin": bytes(g.binary)})), inside)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
def test_index_types(scene, dtype):
    g = Gltf()
    g.mesh(SQUARE, np.array([2, 3, 0], dtype))
    np.testing.assert_array_equal(world(scene("a.glb", g.glb()))[0], SQUARE[[2, 3, 0]])


@pytest.mark.parametrize(
    ("mode", "expected"),
    [(4, [(0, 1, 2)]), (5, [(0, 1, 2), (1, 3, 2), (2, 3, 4)]), (6, [(1, 2, 0), (2, 3, 0), (3, 4, 0)])],
)
def test_triangle_lists_strips_and_fans(scene, mode, expected):
    points = np.random.default_rng(3).random((5, 3), np.float32)
    g = Gltf()
    g.mesh(points, mode=mode)
    g.mesh(points, np.arange(5, dtype=np.uint16), mode=mode)
    description = scene("a.glb", g.glb())
    np.testing.assert_array_equal(world(description, 0), points[expected])
    np.testing.assert_array_equal(world(description, 1), points[expected])


def test_normalized_integers_and_strides(scene):
    g = Gltf()
    uvs = np.array([(0, 255), (51, 102), (255, 0)], np.uint8)
    g.mesh(TRIANGLE, TEXCOORD_0=uvs, NORMAL=np.array([(0, 0, 127), (0, 0, -128), (0, 127, 0)], np.int8))
    for accessor in g.root["accessors"][1:]:
        accessor["normalized"] = True
    # Positions interleaved with other data, 20 bytes per vertex.
    mixed = np.zeros((3, 5), np.float32)
    mixed[:, 1:4] = TRIANGLE
    g.root["accessors"][0] |= {"bufferView": g.view(mixed.tobytes(), byteStride=20), "byteOffset": 4}
    mesh = scene("a.glb", g.glb()).meshes[0]
    np.testing.assert_array_equal(mesh.positions, TRIANGLE)
    np.testing.assert_allclose(mesh.uvs, uvs / 255, rtol=1e-6)
    np.testing.assert_array_equal(mesh.normals, [(0, 0, 1), (0, 0, -1), (0, 1, 0)])


@pytest.mark.parametrize("base", [True, False])
def test_sparse_accessor(scene, base):
    g = Gltf()
    g.mesh(SQUARE, np.array([0, 1, 2, 0, 2, 3], np.uint16))
    accessor = g.root["accessors"][0]
    if not base:
        del accessor["bufferView"]
    places = g.view(np.array([1, 3], np.uint16).tobytes())
    values = g.view(np.array([(5, 0, 0), (0, 7, 0)], np.float32).tobytes())
    accessor["sparse"] = {
        "count": 2,
        "indices": {"bufferView": places, "componentType": 5123},
        "values": {"bufferView": values},
    }
    expected = SQUARE.copy() if base else np.zeros_like(SQUARE)
    expected[[1, 3]] = [(5, 0, 0), (0, 7, 0)]
    np.testing.assert_array_equal(scene("a.glb", g.glb()).meshes[0].positions, expected)


def test_metallic_roughness_with_textures_and_wraps(scene, png):
    g = Gltf()
    uri = "data:image/png;base64," + base64.b64encode(png(255, 0, 0)).decode()
    red = g.texture({"uri": uri}, wrapS=33071, wrapT=33648)
    rough = g.texture({"bufferView": g.view(png(0, 128, 255)), "mimeType": "image/png"})
    shine = g.texture({"uri": "light%20map.png"})
    g.material(
        name="painted",
        pbrMetallicRoughness={
            "baseColorFactor": [0.1, 0.2, 0.3, 1],
            "metallicFactor": 0.25,
            "roughnessFactor": 0.5,
            "baseColorTexture": {"index": red},
            "metallicRoughnessTexture": {"index": rough},
        },
        emissiveFactor=[1, 0.5, 0],
        emissiveTexture={"index": shine},
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 8}, "KHR_materials_ior": {"ior": 1.4}},
        doubleSided=True,
    )
    g.mesh(material=0, TEXCOORD_0=np.zeros((3, 2), np.float32))
    description = scene("a.glb", g.glb(), {"light map.png": png(0, 0, 255)})
    material = description.materials[0]
    assert (material.name, material.kind, material.double_sided) == ("painted", "metallic_roughness", True)
    assert material.base_color == (0.1, 0.2, 0.3)
    assert (material.metallic, material.roughness, material.ior) == (0.25, 0.5, 1.4)
    assert material.emission == (8, 4, 0)
    textures = [
        description.textures[t]
        for t in (material.base_color_texture, material.metallic_roughness_texture, material.emission_texture)
    ]
    assert [description.images[t.image].pixels[0, 0, :3].tolist() for t in textures] == [[255, 0, 0], [0, 128, 255], [0, 0, 255]]
    assert [description.images[t.image].srgb for t in textures] == [True, False, True]
    assert (textures[0].wrap_s, textures[0].wrap_t) == ("clamp", "mirror")
    assert (textures[1].wrap_s, textures[1].wrap_t) == ("repeat", "repeat")
    assert description.warnings == []  # the scene is emissive, so it needs no sky, and everything in it is rendered


def test_default_material_of_primitives(scene):
    g = Gltf()
    g.mesh()
    description = scene("a.glb", g.glb())
    material = description.materials[description.meshes[0].material]
    assert (material.base_color, material.metallic, material.roughness) == ((1, 1, 1), 1, 1)


def test_texture_uv_sets_and_transforms(scene, png):
    g = Gltf()
    texture = g.texture({"bufferView": g.view(png(1, 2, 3)), "mimeType": "image/png"})
    quarter = {"offset": [0.5, 0.25], "scale": [2, 3], "rotation": np.pi / 2, "texCoord": 1}
    info = {"index": texture, "extensions": {"KHR_texture_transform": quarter}}
    g.material(pbrMetallicRoughness={"baseColorTexture": info}, normalTexture={"index": texture, "scale": 0.5, "texCoord": 1})
    uvs, uvs1 = np.array([(0, 0), (1, 0), (0, 1)], np.float32), np.ones((3, 2), np.float32)
    g.mesh(material=0, TEXCOORD_0=uvs, TEXCOORD_1=uvs1)
    description = scene("a.glb", g.glb())
    np.testing.assert_array_equal(description.meshes[0].uvs, uvs)
    np.testing.assert_array_equal(description.meshes[0].uvs1, uvs1)
    color, normal = (description.textures[t] for t in (description.materials[0].base_color_texture, 1))
    assert description.materials[0].normal_scale == 0.5
    assert (color.uv_set, normal.uv_set, normal.transform) == (1, 1, (1, 0, 0, 0, 1, 0))
    # (u, v) -> scaled (2u, 3v) -> rotated (3v, -2u) -> translated: the matrices of the extension's text
    matrix = np.array(color.transform).reshape(2, 3)
    np.testing.assert_allclose(uvs @ matrix[:, :2].T + matrix[:, 2], [(0.5, 0.25), (0.5, -1.75), (3.5, 0.25)], atol=1e-6)


def test_alpha_modes(scene):
    g = Gltf()
    g.material(alphaMode="MASK", alphaCutoff=0.75, pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 0.5]})
    g.material(alphaMode="BLEND")
    g.mesh(material=0)
    masked, blended = scene("a.glb", g.glb()).materials
    assert (masked.alpha_mode, masked.alpha_cutoff, masked.opacity) == ("mask", 0.75, 0.5)
    assert (blended.alpha_mode, blended.alpha_cutoff, blended.opacity) == ("blend", 0.5, 1.0)


@pytest.mark.parametrize("width", [3, 4])
@pytest.mark.parametrize("dtype", [np.float32, np.uint8, np.uint16])
def test_vertex_color_types(scene, dtype, width):
    values = np.array([(0, 0.2, 0.4, 0.6), (0.8, 1, 0.2, 0.4), (1, 0, 1, 0)])[:, :width]
    g = Gltf()
    g.mesh(COLOR_0=values.astype(dtype) if dtype == np.float32 else np.rint(values * np.iinfo(dtype).max).astype(dtype))
    g.root["accessors"][1]["normalized"] = dtype != np.float32
    colors = scene("a.glb", g.glb()).meshes[0].colors
    np.testing.assert_allclose(colors[:, :width], values, atol=1e-6)
    assert width == 4 or (colors[:, 3] == 1).all()


def test_fibres_are_read(scene):
    """The attribute _FIBRE of hair from Blender becomes tangents and diameters."""
    g = Gltf()
    fibres = np.array([(0, 1, 0, 0.25), (0, 1, 0, 0.5), (0, 0, 1, -1)], np.float32)
    g.mesh(NORMAL=np.tile(np.array([0, 0, 1], np.float32), (3, 1)), _FIBRE=fibres)
    (mesh,) = scene("a.glb", g.glb()).meshes
    assert mesh.tangents.tolist() == [[0, 1, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]]
    assert mesh.diameters.tolist() == [0.25, 0.5, 0]


def test_tangents_are_read(scene):
    g = Gltf()
    tangents = np.tile(np.array([1, 0, 0, -1], np.float32), (3, 1))
    g.mesh(NORMAL=np.tile(np.array([0, 0, 1], np.float32), (3, 1)), TANGENT=tangents)
    g.mesh(TANGENT=tangents)  # tangents without normals are ignored
    first, second = scene("a.glb", g.glb()).meshes
    np.testing.assert_array_equal(first.tangents, tangents)
    assert second.tangents is None


def test_specular_glossiness_keeps_its_reflectance(scene):
    g = Gltf()
    for diffuse, specular in (([0.5, 0.4, 0.3, 0.9], [0.04, 0.05, 0.06]), ([0, 0, 0, 1], [1, 0.8, 0.3])):
        extension = {"diffuseFactor": diffuse, "specularFactor": specular, "glossinessFactor": 0.75}
        g.mesh(material=g.material(extensions={"KHR_materials_pbrSpecularGlossiness": extension}))
    wood, gold = scene("a.glb", g.glb()).materials
    assert (wood.base_color, wood.opacity, wood.metallic, wood.roughness) == ((0.5, 0.4, 0.3), 0.9, 0, 0.25)
    f0 = ((wood.ior - 1) / (wood.ior + 1)) ** 2 * np.array(wood.specular_color)
    np.testing.assert_allclose(f0, (0.04, 0.05, 0.06), rtol=0.005)
    assert (gold.base_color, gold.metallic) == ((1, 0.8, 0.3), 1)


def test_a_map_of_specular_and_glossiness_gives_colour_and_roughness(scene):
    out = io.BytesIO()
    Image.fromarray(np.array([[(255, 128, 0, 255), (10, 20, 30, 51)]], np.uint8)).save(out, "PNG")
    g = Gltf()
    texture = g.texture({"bufferView": g.view(out.getvalue()), "mimeType": "image/png"}, wrapS=33071)
    extension = {"specularGlossinessTexture": {"index": texture}, "glossinessFactor": 0.5}
    g.mesh(material=g.material(extensions={"KHR_materials_pbrSpecularGlossiness": extension}))
    description = scene("a.glb", g.glb())
    material = description.materials[0]
    color, rough = (description.textures[t] for t in (material.specular_color_texture, material.metallic_roughness_texture))
    assert description.images[color.image].pixels[0, :, :3].tolist() == [[255, 128, 0], [10, 20, 30]]
    assert (description.images[color.image].srgb, description.images[rough.image].srgb) == (True, False)
    np.testing.assert_allclose(description.images[rough.image].pixels[0, :, 1] / 255, [0.5, 0.9], atol=0.003)
    assert (rough.wrap_s, material.roughness) == ("clamp", 1)


def test_unsupported_extensions_are_named(scene):
    g = Gltf()
    g.material(name="pane", normalTexture={"index": g.texture({"uri": "bumps.png"})}, occlusionTexture={"index": 0})
    g.mesh(material=0)
    g.mesh(mode=1)
    g.root["extensionsUsed"] = ["KHR_materials_common", "KHR_materials_sheen"]
    description = scene("a.glb", g.glb())
    said = " ".join(description.warnings)
    for word in ("pane: its texture bumps.png", "lines", "left out: KHR_materials_common.", "no light"):
        assert word in said
    assert len(description.warnings) == 4


def test_unknown_required_extension_is_an_error(scene):
    g = Gltf()
    g.mesh()
    g.root["extensionsRequired"] = ["KHR_texture_other"]
    with pytest.raises(SceneError, match="KHR_texture_other"):
        scene("a.glb", g.glb())


def test_vrm_is_read_as_glb(scene):
    g = Gltf()
    g.mesh()
    g.root["extensionsRequired"] = g.root["extensionsUsed"] = ["VRMC_vrm", "VRMC_materials_mtoon"]
    description = scene("a.vrm", g.glb())
    assert len(description.instances) == 1
    assert any("left out: VRMC_vrm, VRMC_materials_mtoon" in w for w in description.warnings)


def test_draco_is_decoded(scene):
    draco = pytest.importorskip("DracoPy")
    rng = np.random.default_rng(5)
    points = rng.random((30, 3)).astype(np.float32)
    faces = np.array([(i, i + 1, i + 2) for i in range(28)], np.uint32)
    block = draco.encode(points, faces, quantization_bits=16, preserve_order=True)
    identifier = draco.decode(block).attributes[0]["unique_id"]
    g = Gltf()
    node = g.mesh(points, faces.reshape(-1))
    primitive = g.root["meshes"][node["mesh"]]["primitives"][0]
    view = g.view(block)
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {"POSITION": identifier}}}
    for accessor in g.root["accessors"]:
        del accessor["bufferView"]
    g.root["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    np.testing.assert_allclose(world(scene("a.glb", g.glb())), points[faces], atol=1e-4)


def test_missing_texture_keeps_the_base_color(scene):
    g = Gltf()
    texture = g.texture({"uri": "textures/gone.png"})
    g.material(name="wood", pbrMetallicRoughness={"baseColorFactor": [0.5, 0.4, 0.3, 1], "baseColorTexture": {"index": texture}})
    g.mesh(material=0)
    description = scene("a.glb", g.glb())
    assert description.materials[0].base_color_texture is None
    assert description.materials[0].base_color == (0.5, 0.4, 0.3)
    assert any("wood" in w and "gone.png" in w for w in description.warnings)


@pytest.mark.parametrize(("by", "slots", "warned"), [((2,), (0,), False), ((3, 1), (1, 0), False), ((0, 2, 3), (0, 1, 0), True)])
def test_material_may_use_any_two_uv_sets(scene, png, by, slots, warned):
    """A material may use any two UV sets, not only the first; an occlusion texture's set does not count.

    gltf-transform writes palettes with UV sets after those that a mesh already has.
    """
    g = Gltf()
    sets = {f"TEXCOORD_{k}": np.full((3, 2), k / 10, np.float32) for k in range(5)}
    g.mesh(material=0, **sets)
    images = [{"bufferView": g.view(png(9 * k, 0, 0)), "mimeType": "image/png"} for k in by]
    infos = [{"index": g.texture(image), "texCoord": k} for k, image in zip(by, images, strict=True)]
    keys = ("baseColorTexture", "metallicRoughnessTexture")
    more = {"normalTexture": infos[2]} if len(infos) > 2 else {}
    g.material(pbrMetallicRoughness=dict(zip(keys, infos, strict=False)), occlusionTexture={"index": 0, "texCoord": 4}, **more)
    found = scene("a.glb", g.glb())
    assert sorted(texture.uv_set for texture in found.textures) == sorted(slots)
    read = sorted(by)[:2]
    assert found.meshes[0].uvs[0, 0] == pytest.approx(read[0] / 10)
    assert found.meshes[0].uvs1 is None or found.meshes[0].uvs1[0, 0] == pytest.approx(read[1] / 10)
    assert any("uses UV set 3; only 0, 2 are read" in w for w in found.warnings) == warned
