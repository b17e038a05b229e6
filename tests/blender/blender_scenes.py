"""Small scenes for tests, built in Blender. Run by a Python that has bpy."""

from __future__ import annotations

from typing import Any

import bpy
import mathutils
import numpy as np

SIZE = 96, 72


def principled(name: str, **values) -> bpy.types.Material:
    """Returns a principled material. values: inputs by socket name, with _ for spaces."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    node = material.node_tree.nodes["Principled BSDF"]
    for key, value in values.items():
        node.inputs[key.replace("_", " ")].default_value = value
    return material


def add(primitive: str, material: bpy.types.Material, number: int = 0, smooth: bool = True, **where) -> bpy.types.Object:
    """Adds one of Blender's mesh primitives to the scene, and returns the object.

    primitive: NAME of the operator primitive_NAME_add. number: pass index.
    """
    getattr(bpy.ops.mesh, f"primitive_{primitive}_add")(**where)
    thing = bpy.context.object
    thing.data.materials.append(material)
    thing.pass_index = number
    if smooth:
        bpy.ops.object.shade_smooth()
    return thing


def lamp(kind: str, energy: float, location, **values) -> bpy.types.Object:
    """Adds a light aimed at the centre of the scene."""
    light = bpy.data.lights.new(kind.lower(), kind)
    light.energy = energy
    for key, value in values.items():
        setattr(light, key, value)
    thing = bpy.data.objects.new(kind.lower(), light)
    thing.location = location
    bpy.context.collection.objects.link(thing)
    look(thing)
    return thing


def look(thing: bpy.types.Object, at=(0, 0, 0.6)) -> None:
    """Rotates an object, such as a camera or lamp, so that its -Z axis points at a location."""
    thing.rotation_euler = (mathutils.Vector(at) - thing.location).to_track_quat("-Z", "Y").to_euler()


def empty() -> bpy.types.Scene:
    """Returns a scene without objects, with a small picture size."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    background(scene).inputs["Color"].default_value = (0.2, 0.25, 0.35, 1)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    camera.location = (4.5, -5, 3.2)
    camera.data.lens = 45
    look(camera)
    scene.camera = camera
    return scene


def background(scene: bpy.types.Scene) -> bpy.types.Node:
    """Returns the world's shader node."""
    return scene.world.node_tree.nodes["Background"]


def table(scene: bpy.types.Scene) -> None:
    """Adds objects of several principled materials on a floor."""
    add("plane", principled("floor", Base_Color=(0.6, 0.55, 0.5, 1), Roughness=0.8), 1, size=12)
    add(
        "uv_sphere", principled("red", Base_Color=(0.7, 0.08, 0.05, 1), Roughness=0.35), 2, location=(-1.2, -0.3, 0.7), radius=0.7
    )
    gold = principled("gold", Base_Color=(0.9, 0.6, 0.2, 1), Metallic=1, Roughness=0.5)
    add("uv_sphere", gold, 3, location=(0.5, 0.6, 0.8), radius=0.8)
    coated = principled("coated", Base_Color=(0.05, 0.2, 0.5, 1), Roughness=0.6, Coat_Weight=1, Coat_Roughness=0.4)
    add("cube", coated, 4, smooth=False, location=(1.1, -1.1, 0.45), size=0.9, rotation=(0, 0, 0.6))
    cloth = principled("cloth", Base_Color=(0.1, 0.4, 0.15, 1), Roughness=1, Specular_IOR_Level=0.2)
    add("torus", cloth, 5, location=(-0.3, -1.5, 0.25), major_radius=0.5, minor_radius=0.22)


def world_node(scene: bpy.types.Scene, kind: str) -> bpy.types.Node:
    """Adds a texture node that colours the world, and returns the node."""
    tree = scene.world.node_tree
    node = tree.nodes.new(kind)
    tree.links.new(node.outputs["Color"], background(scene).inputs["Color"])
    return node


def painted(name: str, width: int, height: int, paint, is_float: bool = False, space: str = "") -> bpy.types.Image:
    """Returns a packed image of a function of x and y in 0..1, y upwards.

    space: colour space, set first, since setting it later reloads the image and discards its pixels.
    """
    image = bpy.data.images.new(name, width, height, float_buffer=is_float)
    if space:
        image.colorspace_settings.name = space
    rows = [(*paint((x + 0.5) / width, (y + 0.5) / height), 1.0) for y in range(height) for x in range(width)]
    image.pixels.foreach_set([c for pixel in rows for c in pixel])
    image.update()
    image.pack()
    return image


def blank_images() -> list[str]:
    """Returns the names of used images that have no pixels or a single colour."""
    found = []
    for image in bpy.data.images:
        if image.source == "VIEWER" or not image.users:
            continue
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        colors = pixels.reshape(-1, max(image.channels, 1))[:, :3]
        if not colors.size or np.ptp(colors, axis=0).max() < 1e-3:
            found.append(image.name)
    return found


def textured(material: bpy.types.Material, image: bpy.types.Image, socket: str, scale: float | None = 2.0) -> None:
    """Connects an image to the input `socket` of the material's principled BSDF.

    scale: factor of a Mapping node in between, which also rotates and shifts; None: no Mapping node.
    """
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs[socket])
    if scale is not None:
        mapping, at = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
        mapping.inputs["Scale"].default_value = (scale, scale / 2, 1)
        mapping.inputs["Rotation"].default_value[2] = 0.4
        mapping.inputs["Location"].default_value = (0.1, 0.2, 0)
        tree.links.new(at.outputs["UV"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])


def leaves(scene: bpy.types.Scene) -> None:
    """Adds 14 instances of a collection that contains a cone, each with its own transform."""
    stem = bpy.data.collections.new("stem")
    bpy.ops.mesh.primitive_cone_add(radius1=0.12, depth=0.5)
    thing = bpy.context.object
    thing.data.materials.append(principled("leaf", Base_Color=(0.2, 0.5, 0.1, 1), Roughness=0.9))
    for each in thing.users_collection:
        each.objects.unlink(thing)
    stem.objects.link(thing)
    for i in range(14):
        shown = bpy.data.objects.new(f"leaf {i}", None)
        shown.instance_type, shown.instance_collection = "COLLECTION", stem
        shown.location = (-2.5 + 0.4 * i, 1.6 - 0.05 * i, 0.3)
        shown.rotation_euler = (0.1 * i, 0, 0.3 * i)
        shown.scale = (1, 1, 0.6 + 0.1 * i)
        scene.collection.objects.link(shown)


def smoke_filled(tree: Any, surface: str) -> None:
    """Fills the material with smoke, a volume. surface: "glass" for smoke inside glass; otherwise the material has no surface."""
    shader = tree.nodes["Principled BSDF"]
    if surface == "glass":
        _set(shader, Base_Color=(1, 1, 1, 1), Transmission_Weight=1.0, Roughness=0.3, IOR=1.3)
    else:
        tree.nodes.remove(shader)
    smoke = tree.nodes.new("ShaderNodeVolumePrincipled")
    _set(smoke, Color=(0.8, 0.5, 0.3, 1), Density=2.0, Anisotropy=0.3)
    tree.links.new(smoke.outputs[0], tree.nodes["Material Output"].inputs["Volume"])


def waxen(tree: Any, method: str) -> None:
    """Sets subsurface scattering in the material's principled BSDF. method: Blender's name of the subsurface method."""
    shader = tree.nodes["Principled BSDF"]
    shader.subsurface_method = method
    _set(shader, Subsurface_Weight=1.0, Subsurface_Radius=(1.0, 0.5, 0.3), Subsurface_Scale=0.3)


def _set(node: Any, **values: Any) -> None:
    for name, value in values.items():
        node.inputs[name.replace("_", " ")].default_value = value
