"""Tests that the farm reads scenes written by the add-on correctly."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from blender.rayfarm_addon.scene.files import MAIN, NAME, scene_files
from blender.rayfarm_addon.scene.gltf import object_names
from blender.rayfarm_addon.scene.ids import ids_of
from blender.rayfarm_addon.scene.model import TO_Y_UP, Material, Mesh, Node, Scene, TextureUse
from blender.rayfarm_addon.scene.placing import decompose
from blender.rayfarm_addon.scene.view import Lens, shot_of
from blender.rayfarm_addon.scene.world import read_world
from renderer.scene.animation import Moment, Shutter
from renderer.scene.load import Shot, read
from renderer.scene.object_ids import number_objects
from renderer.scene.shutter_merge import merge_over_shutter
from tests.blender.fake_nodes import Node as Sky
from tests.blender.fake_nodes import linked

TRIANGLE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)


def mesh(key: str, **more) -> Mesh:
    return Mesh(key, TRIANGLE.copy(), [(0, np.array([0, 1, 2], np.uint32))], **more)


def turned(degrees: float, x: float = 0.0, scale: tuple[float, ...] = (1, 1, 1)) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    place = np.eye(4)
    place[:3, :3] = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)]) @ np.diag(scale)
    place[0, 3] = x
    return place


def written(scene: Scene, folder) -> None:
    for name, content in scene_files(scene).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def test_transforms_and_names_are_exported(tmp_path) -> None:
    scene = Scene(meshes={"leaf": mesh("leaf"), "stone": mesh("stone")}, materials={"green": Material("green")})
    places = [turned(40 * i, i, (1, 2, -0.5 * i - 1)) for i in range(12)]
    scene.nodes = [Node(f"leaf {i}", "leaf", ("green",), place, number=i) for i, place in enumerate(places)]
    sheared = np.eye(4)
    sheared[0, 1] = 0.5
    scene.nodes.insert(3, Node("stone", "stone", (), sheared, number=77))
    written(scene, tmp_path)
    found = read(tmp_path, MAIN)
    told = object_names(scene)
    assert len(number_objects(found).names) == len(told) == 13
    for number, node in zip(number_objects(found).instance, told, strict=True):
        instance = found.instances[number]
        np.testing.assert_allclose(instance.transform, TO_Y_UP @ node.place, atol=1e-6, err_msg=node.name)
    assert f"{NAME}/stone" in number_objects(found).names


def test_moving_objects_have_the_exported_keys(tmp_path) -> None:
    keys = [TRIANGLE + np.array((0, 0, z)) for z in (0.0, 0.3, 1.0)]
    shapes = tuple((key.astype(np.float32), None) for key in keys)
    soft = mesh("soft", shapes=shapes)
    soft.positions = shapes[1][0]
    scene = Scene(meshes={"soft": soft, "hard": mesh("hard")}, times=tuple((64 + t) / 24 for t in (-0.25, 0.0, 0.25)))
    places = tuple(turned(30 * i, i) for i in range(3))
    scene.nodes = [Node("hard", "hard", (), places[1], places), Node("soft", "soft", (), np.eye(4))]
    written(scene, tmp_path)
    shot = Shot(tmp_path, MAIN)
    for i, offset in enumerate((-0.25, 0.0, 0.25)):
        found = shot.scene_at(Moment(64, offset=offset))
        by_name = {instance.name: instance for instance in found.instances}
        np.testing.assert_allclose(by_name[f"{NAME}/hard"].transform, TO_Y_UP @ places[i], atol=1e-5)
        np.testing.assert_allclose(found.meshes[by_name[f"{NAME}/soft"].mesh].positions, keys[i], atol=1e-5)
    moving = merge_over_shutter(shot.scene_at, Moment(64), Shutter(0.5))
    assert any(instance.keys for instance in moving.instances)


def test_texture_mapping_matches_blender(tmp_path) -> None:
    """A texture with scale, rotation and shift has in our reader the UVs that a Mapping node of Blender computes.

    Blender computes p' = R (S p) + T with v upwards, while v points downwards in the written file.
    """
    from blender.rayfarm_addon.scene.images import add_pixels

    angle, scale, shift = 0.7, (2.0, 3.0), (0.2, -0.4)
    offset = (shift[0] - scale[1] * np.sin(angle), 1 - shift[1] - scale[1] * np.cos(angle))
    scene = Scene(meshes={"a": mesh("a", uvs=(TRIANGLE[:, :2].copy(),))})
    name = add_pixels(scene, "spots", np.random.default_rng(1).random((4, 4, 4)).astype(np.float32))
    use = TextureUse(name, offset=offset, rotation=angle, scale=scale)
    scene.materials["m"] = Material("m", {"pbrMetallicRoughness": {"baseColorTexture": use}})
    scene.nodes = [Node("a", "a", ("m",), np.eye(4))]
    written(scene, tmp_path)
    found = read(tmp_path, MAIN)
    rows = np.array(found.textures[found.materials[0].base_color_texture].transform).reshape(2, 3)
    c, s = np.cos(angle), np.sin(angle)
    for u, v in ((0.1, 0.9), (0.6, 0.3)):
        x, y = np.array([(c, -s), (s, c)]) @ (np.array(scale) * (u, v)) + shift
        np.testing.assert_allclose(rows @ (u, 1 - v, 1), (x, 1 - y), atol=1e-6)


def test_decomposed_matrix_is_recomposed() -> None:
    random = np.random.default_rng(3)
    for _ in range(20):
        q = random.normal(size=4)
        q /= np.linalg.norm(q)
        x, y, z, w = q
        turn = np.array(
            [
                (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
                (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
                (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
            ]
        )
        place = np.eye(4)
        place[:3, :3] = turn * (2, 0.5, 3)
        _, found, scales, straight = decompose(place[None])
        assert straight.all()
        assert abs(found[0] @ q) == pytest.approx(1)
        np.testing.assert_allclose(scales[0], (2, 0.5, 3))


def projected(shift: tuple[float, float]) -> np.ndarray:
    """Returns Blender's perspective matrix of a lens of 50 mm on a sensor of 36 mm, for a picture of 300 x 200.

    shift: of the lens.
    """
    slope = 18 / 50
    found = np.zeros((4, 4))
    found[0, 0], found[1, 1] = 1 / slope, 1.5 / slope
    found[0, 2], found[1, 2] = 2 * shift[0], 2 * shift[1] * 1.5
    found[2, 2], found[2, 3], found[3, 2] = -1, -0.2, -1
    return found


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.1, -0.2)])
@pytest.mark.parametrize("border", [None, (30, 20, 130, 90)])
def test_pixel_direction_matches_the_projection_matrix(shift, border) -> None:
    size = 300, 200
    projection = projected(shift)
    shot = shot_of(np.eye(4), projection, size, Lens(near=0.1), border)
    x0, y0, x1, y1 = border or (0, 0, *size)
    assert (shot.w, shot.h) == (shot.width, shot.height) == (x1 - x0, y1 - y0)
    assert ("shift_x" in shot.view) == (border is not None or shift[0] != 0)
    slope = np.tan(np.radians(shot.view["fov"]) / 2)
    for x, y in ((x0, y0), (x1, y1), (x0 + 7, y1)):
        ndc = 2 * x / size[0] - 1, 2 * y / size[1] - 1
        wanted = (ndc[0] + projection[0, 2]) / projection[0, 0], (ndc[1] + projection[1, 2]) / projection[1, 1]
        column, row = shot.x + x - x0, shot.height - (shot.y + (y1 - y))
        ours = (
            (2 * column / shot.width - 1) * slope * shot.width / shot.height,
            (2 * row / shot.height - 1) * slope,
        )
        ours = ours[0] + 2 * slope * shot.view.get("shift_x", 0.0), ours[1] + 2 * slope * shot.view.get("shift_y", 0.0)
        np.testing.assert_allclose(ours, wanted, atol=1e-7)


def test_pass_indices_are_looked_up_by_farm_numbers(tmp_path) -> None:
    """Index passes have Blender's pass indices, which the add-on looks up by the farm's numbers of objects and materials.

    This holds also for objects with ray visibility flags, which have materials of their own on the farm.
    """
    scene = Scene(meshes={"a": mesh("a")}, materials={"red": Material("red", number=11), "blue": Material("blue", number=12)})
    flags = ((), ("camera",), ("shadow",), ("shadow",), ("camera", "glossy"), ())
    for i, hidden in enumerate(flags):
        scene.nodes.append(Node(f"{i}", "a", ("blue" if i % 2 else "red",), turned(0, i), number=30 + i, hidden_from=hidden))
    scene.lamp_materials["lamp"] = {"color": 0, "emission": 1.0, "lamp": True}
    scene.lamps.append({"type": "sphere", "name": "lamp", "material": "lamp", "center": [0, 5, 0], "radius": 0.1})
    written(scene, tmp_path)
    found, ids = read(tmp_path, MAIN), ids_of(scene)
    numbers = np.array([i.material if i.material is not None else found.meshes[i.mesh].material for i in found.instances])
    objects = np.array(number_objects(found).instance) + 1
    wanted = {f"{NAME}/{node.name}": (node.number, scene.materials[node.materials[0]].number) for node in scene.nodes}
    told = list(zip(ids.object(objects), ids.material(numbers + 1, objects), strict=True))
    assert told == [wanted[instance.name] for instance in found.instances]
    scene.materials["blue"].gltf = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0}}}
    ids = ids_of(scene)  # only the farm knows which glass has no inside
    assert list(ids.material(np.full(len(objects), 99), objects)) == [wanted[instance.name][1] for instance in found.instances]


@pytest.mark.parametrize(
    ("kind", "has_sun", "strength"), [("NISHITA", True, 4.9), ("HOSEK_WILKIE", False, 0.085), ("PREETHAM", False, 0.65)]
)
def test_sky_is_stored_in_the_scene_file(kind: str, has_sun: bool, strength: float, tmp_path) -> None:
    """A sky of Blender is stored in the scene file, since a job's request cannot have a sun size.

    The expected strength is 49 times Blender's for a sky model that has a sun.
    """
    node = Sky("TEX_SKY", {"Vector": None}, ("Color",), sky_type=kind, sun_direction=(0.0, 0.5, 0.75**0.5))
    node.sun_elevation, node.sun_rotation, node.sun_size, node.sun_disc = np.radians(60), np.radians(30), np.radians(2), True
    node.air_density, node.dust_density, node.ozone_density = 1.0, 2.0, 3.0
    shines = Sky("BACKGROUND", {"Color": None, "Strength": 0.1}, ("Background",))
    output = linked(linked(node, shines, "Color"), Sky("OUTPUT_WORLD", {"Surface": None, "Volume": None}, ()), "Surface")
    tree = SimpleNamespace(get_output_node=lambda engine: output)
    scene = Scene(meshes={"a": mesh("a")}, nodes=[Node("a", "a", (), np.eye(4))])
    scene.world = read_world(scene, SimpleNamespace(use_nodes=True, node_tree=tree))
    assert ["its sky" in sentence for sentence in scene.warnings] == [True]
    written(scene, tmp_path)
    environment = read(tmp_path, MAIN).environment
    assert environment is not None
    assert environment.sky is not None
    np.testing.assert_allclose(np.multiply(environment.color, environment.strength), strength)
    assert environment.sky.sun == has_sun
    assert environment.sky.sun_elevation == pytest.approx(60)
    if has_sun:
        told = [getattr(environment.sky, name) for name in ("sun_azimuth", "sun_size", "air", "dust", "ozone")]
        assert told == pytest.approx([30, 2, 1, 2, 3])
        assert environment.sky.ground_albedo == (0, 0, 0)
