"""glTF: every way its arrays, hierarchy and materials can be written."""

import base64

import numpy as np
import pytest

from renderer.errors import SceneError
from tests.renderer.scene.builders import TRIANGLE, Gltf

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], np.float32)


def world(description, instance=0):
    """An instance's corners in the world, (T, 3, 3)."""
    shown = description.instances[instance]
    mesh = description.meshes[shown.mesh]
    positions = mesh.positions @ shown.transform[:3, :3].T + shown.transform[:3, 3]
    return positions[mesh.triangles]


def test_buffers_inside_beside_and_as_data_uri_are_the_same(scene):
    g = Gltf()
    g.mesh(SQUARE, np.array([0, 1, 2, 0, 2, 3], np.uint16))
    inside = world(scene("a.glb", g.glb()))
    np.testing.assert_array_equal(world(scene("b.gltf", g.gltf())), inside)
    np.testing.assert_array_equal(world(scene("c.gltf", g.gltf("my%20data.bin"), {"my data.bin": bytes(g.binary)})), inside)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
def test_indices_of_every_width(scene, dtype):
    g = Gltf()
    g.mesh(SQUARE, np.array([2, 3, 0], dtype))
    np.testing.assert_array_equal(world(scene("a.glb", g.glb()))[0], SQUARE[[2, 3, 0]])


@pytest.mark.parametrize(
    ("mode", "expected"),
    [(4, [(0, 1, 2)]), (5, [(0, 1, 2), (1, 3, 2), (2, 3, 4)]), (6, [(1, 2, 0), (2, 3, 0), (3, 4, 0)])],
)
def test_lists_strips_and_fans_with_and_without_indices(scene, mode, expected):
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
    # Positions and something else in turn, 20 bytes a vertex.
    mixed = np.zeros((3, 5), np.float32)
    mixed[:, 1:4] = TRIANGLE
    g.root["accessors"][0] |= {"bufferView": g.view(mixed.tobytes(), byteStride=20), "byteOffset": 4}
    mesh = scene("a.glb", g.glb()).meshes[0]
    np.testing.assert_array_equal(mesh.positions, TRIANGLE)
    np.testing.assert_allclose(mesh.uvs, uvs / 255, rtol=1e-6)
    np.testing.assert_array_equal(mesh.normals, [(0, 0, 1), (0, 0, -1), (0, 1, 0)])


@pytest.mark.parametrize("base", [True, False])
def test_sparse_values_replace_some(scene, base):
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


def test_nodes_multiply_down_the_tree_in_both_notations(scene):
    g = Gltf()
    leaf = g.mesh()
    half = np.sqrt(0.5)
    leaf |= {"translation": [1, 2, 3], "rotation": [0, 0, half, half], "scale": [2, 3, 4]}  # a quarter turn about z
    g.root["scenes"][0]["nodes"] = [1]
    g.node(top=False, children=[0], matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 10, 20, 30, 1])
    np.testing.assert_allclose(world(scene("a.glb", g.glb()))[0], [(11, 22, 33), (11, 24, 33), (8, 22, 33)], atol=1e-6)


def test_a_mesh_on_two_nodes_is_kept_once(scene):
    g = Gltf()
    g.mesh()
    g.node(mesh=0, translation=[5, 0, 0])
    description = scene("a.glb", g.glb())
    assert len(description.meshes) == 1
    np.testing.assert_array_equal(world(description, 1)[0], TRIANGLE + np.float32([5, 0, 0]))


def test_nodes_outside_of_the_scene_are_not_shown(scene):
    g = Gltf()
    g.mesh()
    g.node(top=False, mesh=0)
    assert len(scene("a.glb", g.glb()).instances) == 1


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
    assert description.warnings == []  # it shines, so it needs no sky, and everything in it is rendered


def test_a_primitive_without_material_has_the_specifications_default(scene):
    g = Gltf()
    g.mesh()
    description = scene("a.glb", g.glb())
    material = description.materials[description.meshes[0].material]
    assert (material.base_color, material.metallic, material.roughness) == ((1, 1, 1), 1, 1)


def test_the_second_uv_set_is_used_where_the_texture_says_so(scene, png):
    g = Gltf()
    texture = g.texture({"bufferView": g.view(png(1, 2, 3)), "mimeType": "image/png"})
    g.material(pbrMetallicRoughness={"baseColorTexture": {"index": texture, "texCoord": 1}})
    second = np.array([(0.25, 0), (0, 0.5), (1, 1)], np.float32)
    g.mesh(material=0, TEXCOORD_0=np.zeros((3, 2), np.float32), TEXCOORD_1=second)
    np.testing.assert_array_equal(scene("a.glb", g.glb()).meshes[0].uvs, second)


@pytest.mark.parametrize(
    ("transmission", "roughness", "kind"), [(1, 0, "glass"), (0.5, 0, "metallic_roughness"), (1, 0.6, "metallic_roughness")]
)
def test_clear_transmission_is_glass_and_other_is_said_to_be_opaque(scene, transmission, roughness, kind):
    g = Gltf()
    extensions = {"KHR_materials_transmission": {"transmissionFactor": transmission}, "KHR_materials_ior": {"ior": 1.33}}
    g.material(pbrMetallicRoughness={"metallicFactor": 0, "roughnessFactor": roughness}, extensions=extensions)
    g.mesh(material=0)
    description = scene("a.glb", g.glb())
    assert (description.materials[0].kind, description.materials[0].ior) == (kind, 1.33)
    assert any("transmission" in w for w in description.warnings) == (kind != "glass")


def test_texture_transforms_go_into_the_uvs(scene, png):
    g = Gltf()
    texture = g.texture({"bufferView": g.view(png(1, 2, 3)), "mimeType": "image/png"})
    quarter = {"offset": [0.5, 0.25], "scale": [2, 3], "rotation": np.pi / 2, "texCoord": 1}
    info = {"index": texture, "extensions": {"KHR_texture_transform": quarter}}
    g.material(pbrMetallicRoughness={"baseColorTexture": info})
    uvs = np.array([(0, 0), (1, 0), (0, 1)], np.float32)
    g.mesh(material=0, TEXCOORD_0=np.ones((3, 2), np.float32), TEXCOORD_1=uvs)
    # (u, v) -> scaled (2u, 3v) -> turned (3v, -2u) -> moved: the matrices of the extension's text
    expected = [(0.5, 0.25), (0.5, -1.75), (3.5, 0.25)]
    np.testing.assert_allclose(scene("a.glb", g.glb()).meshes[0].uvs, expected, atol=1e-6)


def test_specular_glossiness_becomes_the_nearest_metallic_roughness(scene):
    g = Gltf()
    for diffuse, specular in (([0.5, 0.4, 0.3, 1], [0.04] * 3), ([0, 0, 0, 1], [1, 0.8, 0.3])):
        extension = {"diffuseFactor": diffuse, "specularFactor": specular, "glossinessFactor": 0.75}
        g.mesh(material=g.material(extensions={"KHR_materials_pbrSpecularGlossiness": extension}))
    wood, gold = scene("a.glb", g.glb()).materials
    assert (wood.base_color, wood.metallic, wood.roughness) == ((0.5, 0.4, 0.3), 0, 0.25)
    assert (gold.base_color, gold.metallic) == ((1, 0.8, 0.3), 1)


def test_cameras_look_down_minus_z_of_their_node(scene):
    g = Gltf()
    g.mesh()
    g.root["cameras"] = [
        {"type": "perspective", "name": "lens", "perspective": {"yfov": np.radians(50), "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}},
    ]
    half = np.sqrt(0.5)
    g.node(name="left", camera=0, translation=[1, 2, 3], rotation=[0, half, 0, half])  # a quarter turn about y: looks along -x
    g.node(camera=1)
    description = scene("a.glb", g.glb())
    (camera,) = description.cameras
    assert camera.name == "left"
    assert camera.view.fov == pytest.approx(50)
    assert camera.view.eye == (1, 2, 3)
    direction = np.subtract(camera.view.target, camera.view.eye)
    np.testing.assert_allclose(direction / np.linalg.norm(direction), (-1, 0, 0), atol=1e-12)
    assert any("only perspective" in w for w in description.warnings)


def test_what_is_not_rendered_is_named(scene):
    g = Gltf()
    g.material(alphaMode="BLEND", name="pane", normalTexture={"index": 0})
    g.mesh(material=0, COLOR_0=np.ones((3, 3), np.float32))
    g.mesh(mode=1)
    g.root["animations"] = [{"name": "spin", "channels": [], "samplers": []}]
    g.root["extensionsUsed"] = ["KHR_lights_punctual"]
    description = scene("a.glb", g.glb())
    assert description.animations == ["spin"]
    said = " ".join(description.warnings)
    for word in (
        "pane: alpha mode BLEND",
        "normal map",
        "vertex colours",
        "lines",
        "KHR_lights_punctual",
        "Animations",
        "no light",
    ):
        assert word in said


def test_a_required_extension_that_is_not_known_is_an_error(scene):
    g = Gltf()
    g.mesh()
    g.root["extensionsRequired"] = ["EXT_meshopt_compression"]
    with pytest.raises(SceneError, match="EXT_meshopt_compression"):
        scene("a.glb", g.glb())


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


def test_a_missing_texture_is_a_warning_and_the_base_colour_stays(scene):
    g = Gltf()
    texture = g.texture({"uri": "textures/gone.png"})
    g.material(name="wood", pbrMetallicRoughness={"baseColorFactor": [0.5, 0.4, 0.3, 1], "baseColorTexture": {"index": texture}})
    g.mesh(material=0)
    description = scene("a.glb", g.glb())
    assert description.materials[0].base_color_texture is None
    assert description.materials[0].base_color == (0.5, 0.4, 0.3)
    assert any("wood" in w and "gone.png" in w for w in description.warnings)
