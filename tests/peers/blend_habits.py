"""Writes .blend files, each with one habit of artists (such as linked libraries). Run by a Python that has bpy:

    python blend_habits.py FOLDER [NAME ...]

It also writes told.json, which has, by file and frame, the world bounding box and triangle count of each mesh in Blender's
dependency graph.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from blend_told import told

FOLDER = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else Path()
FRAMES = (1, 4)
LONG = "长" * 20 + "abc"  # 63 bytes, the maximum length of a name


def thing(name: str, at=(0, 0, 0), size: float = 1.0, collection: Any = None) -> Any:
    """Adds a cube with a mesh of its own to `collection`, and returns the object."""
    h = size / 2
    mesh = bpy.data.meshes.new(name)
    corners = [(x, y, z) for x in (-h, h) for y in (-h, h) for z in (-h, h)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    made = bpy.data.objects.new(name, mesh)
    made.location = at
    (collection or bpy.context.scene.collection).objects.link(made)
    return made


def collection(name: str, *children: Any) -> Any:
    """Returns a new collection of cubes, which is in no scene and is shown only by instances."""
    made = bpy.data.collections.new(name)
    for i in range(2):
        each = thing(f"{name} {i}", (0.5 * i, 0, 1.0 * i), 0.6, made)
        each.rotation_euler = (0.2 * i, 0.1, 0)
    return made


def collection_instance(name: str, what: Any, at=(0, 0, 0), into: Any = None) -> Any:
    """Returns an object, linked to the collection `into`, that instances the collection `what` at location `at`."""
    made = bpy.data.objects.new(name, None)
    made.instance_type, made.instance_collection, made.location = "COLLECTION", what, at
    (into or bpy.context.scene.collection).objects.link(made)
    return made


def move(each: Any, path: str, *keys: tuple[float, Any]) -> None:
    """Animates a property of `each` by keyframes. path: name of the property. keys: (frame, value)."""
    for frame, value in keys:
        setattr(each, path, value)
        each.keyframe_insert(path, frame=frame)


def libraries() -> None:
    """Links a collection from a second file; that collection has an instance of a collection linked from a third file.

    An object and a material are linked from the second file too.
    """
    for name, below in (("leaf", None), ("tree", "leaf")):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        made = collection(name)
        made.use_fake_user = True
        if below:
            with bpy.data.libraries.load(str(FOLDER / f"lib-{below}.blend"), link=True, relative=True) as (_, wanted):
                wanted.collections = [below]
            for i in range(3):
                collection_instance(f"{below} {i}", bpy.data.collections[below], (i, 1, 2), made).scale = (1, 1, 1 + i)
        bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / f"lib-{name}.blend"))

    empty()
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "libraries.blend"))
    with bpy.data.libraries.load(str(FOLDER / "lib-tree.blend"), link=True, relative=True) as (_, wanted):
        wanted.collections, wanted.objects = ["tree"], ["tree 1"]
    collection_instance("here", bpy.data.collections["tree"], (3, 0, 0)).rotation_euler = (0, 0, 1)
    bpy.context.scene.collection.objects.link(bpy.data.objects["tree 1"])


def instances() -> None:
    """Adds nested collection instances with animated parents and offsets, and instances on faces and vertices."""
    inner = collection("inner")
    inner.instance_offset = (0.3, 0.2, 0.1)
    outer = bpy.data.collections.new("outer")
    collection_instance("one", inner, (0, 0, 0), outer)
    collection_instance("two", inner, (1, 1, 0), outer).scale = (1, 2, 1)
    carried = collection_instance("carried", outer, (4, 0, 0))
    carrier = bpy.data.objects.new("carrier", None)
    bpy.context.scene.collection.objects.link(carrier)
    carried.parent = carrier
    move(carrier, "location", (1, (0, 0, 0)), (4, (0, 3, 1)))
    move(carrier, "rotation_euler", (1, (0, 0, 0)), (4, (0.3, 0, 1.1)))
    for i, kind in enumerate(("FACES", "VERTS")):
        owner, child = thing(f"owner {kind}", (-4, 3 * i, 0), 2.0), thing(f"child {kind}", (-4, 3 * i, 0), 0.3)
        child.parent = owner
        owner.instance_type = kind


def nodes() -> None:
    """Adds geometry nodes that instance a collection on points, rotated and scaled; a second object realises the instances."""
    scattered = collection("scattered")
    for i, is_real in enumerate((False, True)):
        owner = thing(f"field {i}", (0, 4 * i, 0), 2.0)
        tree = _tree(f"scatter {i}")
        grid = tree.nodes.new("GeometryNodeMeshGrid")
        for key, value in (("Size X", 3.0), ("Size Y", 3.0), ("Vertices X", 3), ("Vertices Y", 3)):
            grid.inputs[key].default_value = value
        on = tree.nodes.new("GeometryNodeInstanceOnPoints")
        info = tree.nodes.new("GeometryNodeCollectionInfo")
        info.inputs[0].default_value = scattered
        tree.links.new(grid.outputs[0], on.inputs["Points"])
        tree.links.new(info.outputs[0], on.inputs["Instance"])
        on.inputs["Rotation"].default_value = (0.1, 0.2, 0.3)
        on.inputs["Scale"].default_value = (0.5, 0.6, 0.7)
        out = on.outputs[0]
        if is_real:
            real = tree.nodes.new("GeometryNodeRealizeInstances")
            tree.links.new(out, real.inputs[0])
            out = real.outputs[0]
        tree.links.new(out, next(n for n in tree.nodes if n.type == "GROUP_OUTPUT").inputs[0])
        owner.modifiers.new("nodes", "NODES").node_group = tree


def _tree(name: str) -> Any:
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.nodes.new("NodeGroupInput")
    tree.nodes.new("NodeGroupOutput")
    return tree


def growing() -> None:
    """Adds geometry nodes whose instances rotate with the scene's time."""
    owner = thing("clock", (0, 0, 0), 1.0)
    tree = _tree("clock")
    line = tree.nodes.new("GeometryNodeMeshLine")
    line.inputs["Count"].default_value = 4
    on, cube = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("GeometryNodeMeshCube")
    time, add = tree.nodes.new("GeometryNodeInputSceneTime"), tree.nodes.new("ShaderNodeCombineXYZ")
    tree.links.new(time.outputs["Seconds"], add.inputs["Z"])
    tree.links.new(line.outputs[0], on.inputs["Points"])
    tree.links.new(cube.outputs[0], on.inputs["Instance"])
    tree.links.new(add.outputs[0], on.inputs["Rotation"])
    tree.links.new(on.outputs[0], next(n for n in tree.nodes if n.type == "GROUP_OUTPUT").inputs[0])
    owner.modifiers.new("nodes", "NODES").node_group = tree


def modifiers() -> None:
    """Adds objects with stacks of modifiers, a boolean cutter that is not rendered, a curve modifier, a text and a metaball."""
    block = thing("block", (0, 0, 0), 1.0)
    array = block.modifiers.new("array", "ARRAY")
    array.count, array.relative_offset_displace = 3, (1.2, 0, 0)
    block.modifiers.new("mirror", "MIRROR").use_axis = (False, True, False)
    block.modifiers.new("bevel", "BEVEL").width = 0.05
    cutter = thing("cutter", (0.4, 0.4, 0.4), 0.8)
    cutter.hide_render = True
    cut = thing("cut", (0, 4, 0), 1.0)
    boolean = cut.modifiers.new("cut", "BOOLEAN")
    boolean.object, cutter.parent = cutter, cut
    solid = thing("shell", (0, -4, 0), 1.0)
    solid.modifiers.new("solid", "SOLIDIFY").thickness = 0.1
    smooth = solid.modifiers.new("smooth", "SUBSURF")
    smooth.levels = smooth.render_levels = 2
    triangulated = solid.modifiers.new("triangles", "TRIANGULATE")
    triangulated.min_vertices = 4
    text = bpy.data.objects.new("text", bpy.data.curves.new("text", "FONT"))
    text.data.body, text.data.extrude, text.location = "Ab", 0.1, (4, 0, 0)
    bpy.context.scene.collection.objects.link(text)


def keys() -> None:
    """Adds shape keys: animated ones, one driven by arithmetic, absolute ones, one with a value above 1, and a muted one."""
    soft = thing("soft")
    soft.shape_key_add(name="Basis")
    for i, name in enumerate(("wide", "tall", "muted")):
        key = soft.shape_key_add(name=name)
        for each in key.data:
            each.co[i] *= 2.5
    blocks = soft.data.shape_keys.key_blocks
    blocks["wide"].slider_max = 2.0
    move(blocks["wide"], "value", (1, 0.0), (4, 1.6))
    blocks["muted"].value, blocks["muted"].mute = 1.0, True
    driver = blocks["tall"].driver_add("value").driver
    variable = driver.variables.new()
    variable.name, variable.targets[0].id, variable.targets[0].data_path = "x", soft, "location.x"
    driver.type, driver.expression = "SCRIPTED", "x / 4 + 0.1"
    move(soft, "location", (1, (0, 0, 0)), (4, (2, 0, 0)))


def rigs() -> None:
    """Adds a bone's child, constraints (track to, copy rotation, child of), a vertex parent, and delta transforms."""
    arm = bpy.data.objects.new("arm", bpy.data.armatures.new("arm"))
    bpy.context.scene.collection.objects.link(arm)
    bpy.context.view_layer.objects.active = arm
    bpy.ops.object.mode_set(mode="EDIT")
    bone = arm.data.edit_bones.new("bone")
    bone.head, bone.tail = (0, 0, 0), (0, 0, 2)
    bpy.ops.object.mode_set(mode="OBJECT")
    arm.location = (1, 0, 0)
    pose = arm.pose.bones["bone"]
    pose.rotation_mode = "XYZ"
    move(pose, "rotation_euler", (1, (0, 0, 0)), (4, (1.0, 0.2, 0)))
    hung = thing("hung", (0.2, 0.1, 0.3), 0.5)
    hung.parent, hung.parent_type, hung.parent_bone = arm, "BONE", "bone"
    looks = thing("looks", (3, 3, 0), 0.5)
    track = looks.constraints.new("TRACK_TO")
    track.target, track.track_axis, track.up_axis = hung, "TRACK_X", "UP_Z"
    held = thing("held", (-2, 0, 0), 0.5)
    child = held.constraints.new("CHILD_OF")
    child.target = hung
    odd = thing("odd", (0, 3, 0), 0.7)
    odd.delta_location, odd.delta_scale = (0.1, 0.2, 0.3), (1, 2, 1)
    odd.parent = looks
    odd.matrix_parent_inverse = looks.matrix_world.inverted()


def layers() -> None:
    """Adds two scenes and three view layers, with collections that are excluded, not rendered, or hidden only in the viewport."""
    scene = bpy.context.scene
    thing("plain")
    for i, name in enumerate(("excluded", "unrendered", "unseen in the viewport", "hidden by eye")):
        made = bpy.data.collections.new(name)
        scene.collection.children.link(made)
        thing(name, (i + 1, 0, 0), 0.5, made)
        child = bpy.data.collections.new(f"below {name}")
        made.children.link(child)
        thing(f"below {name}", (i + 1, 2, 0), 0.5, child)
    layer = bpy.context.view_layer
    layer.layer_collection.children["excluded"].exclude = True
    bpy.data.collections["unrendered"].hide_render = True
    bpy.data.collections["unseen in the viewport"].hide_viewport = True
    layer.layer_collection.children["hidden by eye"].hide_viewport = True
    scene.view_layers.new("second")
    other = bpy.data.scenes.new("other scene")
    other.collection.objects.link(bpy.data.objects["plain"])
    for i in range(2):
        camera = bpy.data.objects.new(f"camera {i}", bpy.data.cameras.new("camera"))
        camera.location = (i, -6, 1)
        scene.collection.objects.link(camera)
        scene.timeline_markers.new(f"shot {i}", frame=1 + 2 * i).camera = camera
    scene.camera = bpy.data.objects["camera 0"]


def textures() -> None:
    """Adds image textures: packed, missing, tiled and image sequences, mapped by two UV sets."""
    picture = np.ones((8, 8, 4), np.float32)
    picture[..., 0] = np.linspace(0, 1, 8)

    def image(name: str, path: str = "", source: str = "FILE") -> Any:
        made = bpy.data.images.new(name, 8, 8)
        made.pixels.foreach_set(picture.ravel())
        made.update()
        if path:
            made.filepath_raw, made.file_format = str(FOLDER / path), "PNG"
            made.save()
            bpy.data.images.remove(made)
            made = bpy.data.images.load(str(FOLDER / path))
            made.name, made.source = name, source
        else:
            made.pack()
        return made

    kinds = {
        "packed": image("packed"),
        "missing": image("missing", "gone.png"),
        "sequence": image("sequence", "shot.0001.png", "SEQUENCE"),
    }
    (FOLDER / "gone.png").unlink()
    for tile in (1002, 1011):
        image("tile", f"udim.{tile}.png")
    kinds["tiles"] = image("tiles", "udim.1001.png", "TILED")
    for tile in (1002, 1011):
        kinds["tiles"].tiles.new(tile_number=tile)
    kinds["tiles"].filepath = str(FOLDER / "udim.<UDIM>.png")
    for i, (name, found) in enumerate(kinds.items()):
        each = thing(name, (2 * i, 0, 0))
        each.data.uv_layers.new(name="first")
        each.data.uv_layers.new(name="second")
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        node = material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = found
        if name == "sequence":
            node.image_user.frame_duration = 1
        material.node_tree.links.new(node.outputs[0], material.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
        each.data.materials.append(material)


def colors() -> None:
    """Adds meshes with colour attributes per point and per corner, stored as bytes and as floats."""
    for i, (domain, kind) in enumerate((d, k) for d in ("POINT", "CORNER") for k in ("BYTE_COLOR", "FLOAT_COLOR")):
        each = thing(f"{domain} {kind}", (2 * i, 0, 0))
        layer = each.data.color_attributes.new("tint", kind, domain)
        count = len(layer.data)
        values = np.ones((count, 4), np.float32)
        values[:, 0], values[:, 1], values[:, 2] = np.linspace(0.1, 0.9, count), 0.25, 0.5
        layer.data.foreach_set("color", values.ravel())
        material = bpy.data.materials.new(f"{domain} {kind}")
        material.use_nodes = True
        node = material.node_tree.nodes.new("ShaderNodeVertexColor")
        node.layer_name = "tint"
        material.node_tree.links.new(node.outputs[0], material.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
        each.data.materials.append(material)


def units() -> None:
    """Sets the scene's unit to centimetres, and adds two objects of extreme size: a country's and a grain's."""
    settings = bpy.context.scene.unit_settings
    settings.system, settings.scale_length = "METRIC", 0.01
    thing("country", (0, 0, -6e5), 1e6)
    thing("grain", (2, 0, 0), 1e-3)
    thing("far", (3e4, -2e4, 1e3), 1.0)


def names() -> None:
    """Adds objects with difficult names.

    They have maximum length, other scripts, other case, separators, or equal beginnings.
    """
    for i, name in enumerate(
        (LONG, LONG[:-1] + "d", "Ünïcödé/with\\slashes", "cube", "Cube", "a: [b] {c} #d 'e' \"f\"", "\n", "🫖")
    ):
        each = thing(name, (2 * i, 0, 0))
        material = bpy.data.materials.new(name)
        each.data.materials.append(material)
    shared = bpy.data.objects["cube"].data
    again = bpy.data.objects.new("cube.001", shared)
    again.location = (0, 3, 0)
    bpy.context.scene.collection.objects.link(again)


def large() -> None:
    """Adds a smooth mesh that exceeds the limits of Blender's exporter, with sharp edges and two UV sets.

    The mesh uses two of its three materials.
    """
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=180, y_subdivisions=120, size=4)
    grid = bpy.context.object
    grid.name = "wavy"
    mesh = grid.data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    points[2::3] = 0.3 * np.sin(3 * points[0::3])
    mesh.vertices.foreach_set("co", points)
    second = mesh.uv_layers.new(name="second")
    second.uv.foreach_set("vector", np.tile(np.float32((0.25, 0.75)), len(mesh.loops)))
    for name in ("left", "unused", "right"):
        mesh.materials.append(bpy.data.materials.new(name))
    mesh.polygons.foreach_set("material_index", np.where(np.arange(len(mesh.polygons)) % 180 < 90, 0, 2).astype(np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    mesh.edges.foreach_set("use_edge_sharp", np.arange(len(mesh.edges)) % 50 == 0)
    mesh.update()
    twin = bpy.data.objects.new("twin", mesh)
    twin.location, twin.scale, twin.parent = (0, 6, 0), (1, 0.5, 2), grid
    bpy.context.scene.collection.objects.link(twin)


FILES: dict[str, Callable[[], None]] = {
    each.__name__: each
    for each in (libraries, instances, nodes, growing, modifiers, keys, rigs, layers, textures, colors, units, names, large)
}


def empty() -> None:
    """Creates a scene without objects, with several frames."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, FRAMES[0], FRAMES[-1]


if __name__ == "__main__":
    everything = {}
    for name in sys.argv[2:] or FILES:
        empty()
        FILES[name]()
        bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / f"{name}.blend"))
        everything[name] = {str(frame): told(frame) for frame in FRAMES}
    (FOLDER / "told.json").write_text(json.dumps(everything))
