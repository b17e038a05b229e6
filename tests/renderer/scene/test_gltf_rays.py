"""Tests of our glTF extension for nodes hidden from some rays, and of the script that adds it to a GLB from Blender."""

from types import SimpleNamespace

import numpy as np

from renderer.arrays.rows import CATCHER, CATCHES, HOLDOUT, SHADELESS, UNSEEN
from renderer.blender.inside.light_groups import layer_groups, light_group_of
from renderer.blender.inside.light_links import LinkSets
from renderer.blender.inside.ray_visibility import RAYS, matte_flags_of, note_rays, write_extensions
from renderer.scene.compile import compile_scene
from renderer.scene.description import LightLink
from renderer.scene.object_ids import number_objects
from tests.renderer.scene.builders import Gltf


def test_ray_visibility_applies_per_node(scene):
    g = Gltf()
    g.mesh()
    g.node(mesh=0, extensions={RAYS: {"camera": False}})
    g.node(mesh=0, extensions={RAYS: {"camera": True, "shadow": False}})
    g.node(mesh=0, extensions={RAYS: {"camera": False}})
    g.root["extensionsUsed"] = [RAYS]
    found = scene("a.glb", g.glb())
    materials = [found.materials[found.meshes[0].material if i.material is None else i.material] for i in found.instances]
    assert [(m.unseen, m.shadeless) for m in materials] == [(False, False), (True, False), (False, True), (True, False)]
    assert len(found.materials) == 3, "each kind once"
    assert not any("RAYFARM" in each for each in found.warnings)
    flags = compile_scene(found).material_flags
    assert [bool(f & UNSEEN) for f in flags] == [False, True, False]
    assert [bool(f & SHADELESS) for f in flags] == [False, False, True]


def test_ray_visibility_is_written_by_node_name(scene, tmp_path):
    g = Gltf()
    g.mesh()
    g.node(mesh=0, name="hidden")
    g.node(name="hidden", translation=[1.0, 0.0, 0.0])
    g.root["materials"] = [{"name": "leaf"}]
    g.root["meshes"][0]["primitives"][0]["material"] = 0
    path = tmp_path / "b.glb"
    path.write_bytes(g.glb())
    leaf: dict = {"roughnessFactor": 0.3, "baseColorFactor": [0.5, 1.0, 1.0]}
    leaf |= {"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5}}
    write_extensions(path, {"hidden": {"camera": False, "shadow": False}}, {"leaf": leaf}, {})
    found = scene("b.glb", path.read_bytes())
    assert [i.material is not None for i in found.instances] == [False, True]
    hidden = found.materials[found.instances[1].material]
    assert (hidden.unseen, hidden.shadeless) == (True, True)
    assert (hidden.diffuse_transmission, hidden.roughness, hidden.base_color) == (0.5, 0.3, (0.5, 1.0, 1.0))
    np.testing.assert_array_equal(found.meshes[0].positions, scene("a.glb", g.glb()).meshes[0].positions)


def test_light_groups_in_extras(scene, tmp_path):
    """Light groups are read from the extras of materials, lights and nodes; a node's takes precedence."""
    lights = "KHR_lights_punctual"
    g = Gltf()
    g.mesh(material=g.material(emissiveFactor=[1.0, 1.0, 1.0], extras={"light_group": " key "}))
    g.root["extensions"] = {lights: {"lights": [{"type": "point", "extras": {"light_group": "lamps"}}]}}
    g.root["extensionsUsed"] = [lights]
    g.node(mesh=0)
    g.node(mesh=0, name="other", translation=[3.0, 0.0, 0.0])
    g.node(extensions={lights: {"light": 0}})
    g.node(extensions={lights: {"light": 0}}, extras={"light_group": "rim"})
    g.node(extensions={lights: {"light": 0}}, extras={"light_group": "no.name"})
    path = tmp_path / "b.glb"
    path.write_bytes(g.glb())
    write_extensions(path, {}, {}, {"other": {"light_group": "practical", "light_link": "some"}})
    found = scene("b.glb", path.read_bytes())
    materials = [found.materials[found.meshes[i.mesh].material if i.material is None else i.material] for i in found.instances]
    assert [m.light_group for m in materials][-2:] == ["key", "practical"]
    assert [light.light_group for light in found.lights] == ["lamps", "rim", "lamps"]
    assert [m.light_link for m in materials][-2:] == ["", "some"]
    assert any("light_group that is not a name" in each for each in found.warnings)


def test_extras_make_holdouts_and_shadow_catchers(scene, tmp_path):
    """Extras of a material apply to all nodes; extras of a node leave other nodes of its mesh unchanged. Only `true` counts."""
    g = Gltf()
    g.mesh(material=g.material(extras={"shadow_catcher": True}))
    g.node(mesh=0, name="floor")
    g.node(mesh=0, name="both", extras={"holdout": True})
    g.node(mesh=0, name="wet", extras={"reflection_catcher": True})
    g.node(mesh=0, name="held")
    g.node(mesh=0, name="odd", extras={"holdout": "yes"})
    path = tmp_path / "b.glb"
    path.write_bytes(g.glb())
    write_extensions(path, {}, {}, {"held": {"holdout": True}})
    found = scene("b.glb", path.read_bytes())
    materials = {i.name: found.materials[0 if i.material is None else i.material] for i in found.instances}
    held = {name: (m.holdout, m.shadow_catcher) for name, m in materials.items() if name in ("floor", "both", "held", "odd")}
    assert held == {"floor": (False, True), "both": (True, True), "held": (True, True), "odd": (False, True)}
    assert [name for name, m in materials.items() if m.reflection_catcher] == ["wet"]
    flags = compile_scene(found).material_flags
    assert {int(each) for each in flags & (HOLDOUT | CATCHES)} >= {CATCHER, HOLDOUT | CATCHER, CATCHES}


def test_mattes_of_blender_objects():
    layer, notes = SimpleNamespace(indirect_only_get=lambda view_layer: False), []
    held = SimpleNamespace(name="held", holdout_get=lambda view_layer: True, is_shadow_catcher=False)
    catcher = {"shadow_catcher": True, "reflection_catcher": True}
    floor = SimpleNamespace(name="floor", holdout_get=lambda view_layer: False, is_shadow_catcher=True)
    assert [matte_flags_of(each, layer) for each in (held, floor)] == [{"holdout": True}, catcher]
    note_rays([held, floor], layer, notes, is_transparent=True)
    assert not notes
    note_rays([held, floor], layer, notes, is_transparent=False)
    assert ["holdout" in notes[0], "shadow catcher" in notes[1], len(notes)] == [True, True, 2]


def test_extras_hide_nodes_from_kinds_of_rays(scene):
    """Extras state the kinds of rays that see a node, and the extension those that do not; unknown kinds hide nothing."""
    g = Gltf()
    g.mesh(material=g.material(extras={"shadow_link": "hero"}))
    g.node(mesh=0, extras={"visible_to": ["camera", "diffuse", "glossy"]})
    g.node(mesh=0, extensions={RAYS: {"glossy": False, "volume": False}})
    g.node(mesh=0, extras={"visible_to": ["camera", "x-rays"], "shadow_link": "other"})
    g.root["extensionsUsed"] = [RAYS]
    found = scene("a.glb", g.glb())
    materials = [found.materials[i.material] for i in found.instances[-3:]]
    looks = [(m.unseen, m.shadeless, m.hidden_from, m.shadow_link) for m in materials]
    hidden = ("transmission", "volume"), ("glossy", "volume")
    assert looks == [(False, True, hidden[0], "hero"), (False, False, hidden[1], "hero"), (False, False, (), "other")]
    assert any("visible_to that is not a list of camera" in each for each in found.warnings)


def test_extras_declare_link_sets(scene):
    lights = "KHR_lights_punctual"
    g = Gltf()
    g.mesh(material=g.material(emissiveFactor=[1.0, 1.0, 1.0], extras={"light_link": "hero"}))
    g.root["extensions"] = {lights: {"lights": [{"type": "point"}]}}
    g.root["extensionsUsed"] = [lights]
    g.node(mesh=0, name="a")
    g.node(mesh=0, name="b")
    g.node(extensions={lights: {"light": 0}}, extras={"light_link": "rest"})
    g.root["scenes"][0]["extras"] = {
        "light_links": {"hero": {"include": ["a"]}, "rest": {"exclude": ["a"]}, "odd": {"include": "a"}}
    }
    found = scene("a.glb", g.glb())
    assert found.light_links == {"hero": LightLink(("a",)), "rest": LightLink(None, ("a",))}
    assert found.lights[0].light_link == "rest"
    assert any("light_links that are not lists" in each for each in found.warnings)
    compiled = compile_scene(found)
    masks = dict(zip(number_objects(found).names, compiled.object_links.tolist(), strict=True))
    assert (masks["a"], masks["b"]) == (0b011, 0b101)
    assert sorted({*compiled.light_link.tolist()}) == [1, 2]


def _linking(collection: object) -> SimpleNamespace:
    return SimpleNamespace(name="lamp", light_linking=SimpleNamespace(receiver_collection=collection))


def _collection(name: str, states: dict[str, str], child: tuple[str, str] | None = None) -> SimpleNamespace:
    """Returns a collection with objects in link states and, if given, a child collection with one object and a state."""
    things = [SimpleNamespace(name=each) for each in states]
    links = [SimpleNamespace(light_linking=SimpleNamespace(link_state=state)) for state in states.values()]
    children, child_links = [], []
    if child is not None:
        children = [SimpleNamespace(all_objects=[SimpleNamespace(name=child[0])])]
        child_links = [SimpleNamespace(light_linking=SimpleNamespace(link_state=child[1]))]
    return SimpleNamespace(
        name=name, objects=things, collection_objects=links, children=children, collection_children=child_links
    )


def test_receiver_and_blocker_collections_of_blender_become_link_sets():
    names = {name: f"Scene/{name}" for name in ("a", "b", "c")}
    links = LinkSets(names, notes := [])
    assert links.fields_for(SimpleNamespace(name="lamp")) == links.fields_for(_linking(None)) == {}
    some = _collection("Some.001", {"a": "INCLUDE", "hidden": "INCLUDE", "b": "EXCLUDE"}, ("c", "INCLUDE"))
    assert [links.fields_for(_linking(some))["light_link"] for _ in range(2)] == ["Some_001"] * 2
    assert links.fields_for(_linking(_collection("Some 001", {"c": "EXCLUDE"})))["light_link"] == "Some 001"
    assert links.fields_for(_linking(_collection("none", {})))["light_link"] == "none"
    blocker = SimpleNamespace(name="lamp", light_linking=SimpleNamespace(receiver_collection=None, blocker_collection=some))
    assert links.fields_for(blocker) == {"shadow_link": "Some_001"}
    assert links.sets == {
        "Some_001": {"include": ["Scene/a", "Scene/c"], "exclude": ["Scene/b"]},
        "Some 001": {"exclude": ["Scene/c"]},
        "none": {"include": []},
    }
    assert not notes


def test_blender_light_group_names_are_sanitized():
    layer = SimpleNamespace(lightgroups=[SimpleNamespace(name=n) for n in ("Key.001", "rest", "Fenster süd", "Key.001")])
    assert layer_groups(layer) == "Key_001,Fenster süd"
    assert layer_groups(SimpleNamespace()) == ""
    assert light_group_of(SimpleNamespace(lightgroup="a/b ")) == "a_b"
    assert light_group_of(SimpleNamespace()) == ""
