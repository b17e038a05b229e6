"""Scenes with features that artists use, beyond plain surfaces and lamps. Run by a Python that has bpy."""

from __future__ import annotations

import math

import bpy
from blender_scenes import add, background, empty, lamp, look, painted, principled, table, textured, world_node

PRINCIPLED = "Principled BSDF"


def _front(scene: bpy.types.Scene) -> None:
    """Adds a floor, a lamp, and a camera, in front of which objects are placed in rows."""
    add("plane", principled("floor", Base_Color=(0.5, 0.5, 0.5, 1), Roughness=0.9, Specular_IOR_Level=0.0), size=14)
    lamp("AREA", 400, (2.5, -3.5, 5), size=2.5)
    background(scene).inputs["Strength"].default_value = 0.6
    scene.camera.location, scene.camera.data.lens = (0, -6, 2.4), 50
    look(scene.camera, (0, 0, 0.4))


def _row(materials: list[bpy.types.Material], y: float) -> None:
    for i, material in enumerate(materials):
        place = (i - (len(materials) - 1) / 2) * 1.0, y, 0.42
        add("uv_sphere", material, location=place, radius=0.42, segments=48, ring_count=24)


def _mix(name: str, first: tuple[str, dict], second: tuple[str, dict], share: float = 0.5):
    """Returns (a material that mixes two shaders, its Mix Shader node). first, second: (node type, inputs).

    share: weight of `second`.
    """
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix.inputs[0].default_value = share
    for i, (kind, values) in enumerate((first, second)):
        node = tree.nodes.new(kind)
        for key, value in values.items():
            node.inputs[key].default_value = value
        tree.links.new(node.outputs[0], mix.inputs[1 + i])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material, mix


def _textured_material(name: str, build, image: bpy.types.Image, socket: str = "Base Color", **values) -> bpy.types.Material:
    """Returns a principled material with one input taken from an image through other nodes.

    build: function of (node tree, the image's colour output) that adds these nodes and returns their output.
    """
    material = principled(name, Roughness=0.8, **values)
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(build(tree, node.outputs["Color"]), tree.nodes[PRINCIPLED].inputs[socket])
    return material


def _new(tree: bpy.types.NodeTree, kind: str, values: dict, source, into, output: int = 0, **more):
    node = tree.nodes.new(kind)
    for key, value in more.items():
        setattr(node, key, value)
    for key, value in values.items():
        node.inputs[key].default_value = value
    tree.links.new(source, node.inputs[into])
    return node.outputs[output]


def shaders() -> bpy.types.Scene:
    """Returns a scene with two rows of balls: mixed shaders in the upper row, and images through nodes in the lower one."""
    scene = empty()
    _front(scene)
    diffuse, glossy = "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfGlossy"
    red = {"Color": (0.6, 0.1, 0.1, 1)}
    half, _ = _mix("half", (diffuse, red), (glossy, {**red, "Roughness": 0.3}), 0.3)
    polished, mix = _mix(
        "polished", (diffuse, {"Color": (0.1, 0.3, 0.6, 1)}), (glossy, {"Color": (1, 1, 1, 1), "Roughness": 0.15})
    )
    fresnel = polished.node_tree.nodes.new("ShaderNodeFresnel")
    polished.node_tree.links.new(fresnel.outputs[0], mix.inputs[0])
    masked, mix = _mix(
        "masked",
        ("ShaderNodeBsdfPrincipled", {"Base Color": (0.8, 0.6, 0.2, 1), "Metallic": 1, "Roughness": 0.4}),
        ("ShaderNodeBsdfPrincipled", {"Base Color": (0.1, 0.1, 0.1, 1), "Roughness": 0.9}),
    )
    mask = painted("mask", 64, 64, lambda x, y: (float(int(x * 8) % 2 == int(y * 8) % 2),) * 3, space="Non-Color")
    node = masked.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = mask
    masked.node_tree.links.new(node.outputs[0], mix.inputs[0])
    veil, _ = _mix("veil", ("ShaderNodeBsdfTransparent", {}), (diffuse, {"Color": (0.2, 0.7, 0.2, 1)}), 0.6)
    _row([half, polished, masked, veil], 0.8)

    colors = painted("colors", 64, 64, lambda x, y: (0.1 + 0.8 * x, 0.8 * y, 0.5 + 0.4 * math.sin(20 * x) * math.cos(15 * y)))

    def ramp(tree, source):
        made = _new(tree, "ShaderNodeValToRGB", {}, source, "Fac")
        first, last = made.node.color_ramp.elements
        first.position, first.color, last.position, last.color = 0.3, (0.8, 0.1, 0, 1), 0.7, (0, 0.2, 0.9, 1)
        return made

    def hue(tree, source):
        return _new(tree, "ShaderNodeHueSaturation", {"Hue": 0.7, "Saturation": 1.3, "Value": 0.8}, source, "Color")

    def overlay(tree, source):
        return _new(tree, "ShaderNodeMixRGB", {"Fac": 0.8, "Color2": (0.9, 0.3, 0.2, 1)}, source, "Color1", blend_type="OVERLAY")

    def curves(tree, source):
        made = _new(tree, "ShaderNodeRGBCurve", {}, source, "Color")
        made.node.mapping.curves[3].points.new(0.3, 0.6)
        made.node.mapping.update()
        return _new(tree, "ShaderNodeBrightContrast", {"Contrast": 0.4}, made, "Color")

    _row([_textured_material(build.__name__, build, colors) for build in (ramp, hue, overlay, curves)], -0.5)
    return scene


def suns() -> bpy.types.Scene:
    """Returns a scene with a sun of non-zero size, mirrors and glossy balls, and two point lights close to surfaces.

    One of the point lights has soft falloff, the other has not.
    """
    scene = empty()
    _front(scene)
    bpy.data.objects["area"].hide_render = True
    background(scene).inputs["Strength"].default_value = 0.3
    lamp("SUN", 3.0, (2, -3, 5), angle=0.3).visible_camera = False
    for x, is_soft in ((-1.5, True), (1.5, False)):
        point = lamp("POINT", 25, (x, -0.9, 1.0), shadow_soft_size=0.4, use_soft_falloff=is_soft)
        point.visible_camera = False
    mirror = principled("mirror", Base_Color=(0.9, 0.9, 0.9, 1), Metallic=1, Roughness=0.0)
    glossy = principled("glossy", Base_Color=(0.9, 0.9, 0.9, 1), Metallic=1, Roughness=0.3)
    _row([mirror, glossy, principled("white", Base_Color=(0.8, 0.8, 0.8, 1), Roughness=0.5)], 0.3)
    return scene


def rays() -> bpy.types.Scene:
    """Returns a scene with objects hidden from camera rays or from shadow rays, and a collection seen only in a mirror."""
    scene = empty()
    _front(scene)
    matt = {"Roughness": 0.8, "Specular_IOR_Level": 0.0}
    _row([principled(name, Base_Color=(0.7, 0.4, 0.1, 1), **matt) for name in ("unseen", "shadeless", "plain", "indirect")], 0.8)
    balls = sorted((each for each in scene.objects if each.name.startswith("Sphere")), key=lambda each: each.location[0])
    balls[0].visible_camera = False
    balls[1].visible_shadow = False
    aside = bpy.data.collections.new("aside")
    scene.collection.children.link(aside)
    scene.collection.objects.unlink(balls[3])
    aside.objects.link(balls[3])
    bpy.context.view_layer.layer_collection.children["aside"].indirect_only = True
    mirror = principled("mirror", Base_Color=(0.95, 0.95, 0.95, 1), Metallic=1, Roughness=0.0)
    add("cube", mirror, smooth=False, location=(0, 2.2, 0.6), size=1.2, rotation=(0.2, 0, 0))
    return scene


def bumps() -> bpy.types.Scene:
    """Returns a scene with two rows of balls: bump maps in the upper row, and normal maps in the lower one.

    The bump maps have several strengths and distances, and one is inverted.
    """
    scene = empty()
    add("plane", principled("floor", Base_Color=(0.5, 0.5, 0.5, 1), Roughness=0.9, Specular_IOR_Level=0.0), size=14)
    background(scene).inputs["Strength"].default_value = 0.1
    lamp("SUN", 3.0, (4, -2.5, 1.6), angle=0.05)
    scene.camera.location, scene.camera.data.lens = (0, -6, 2.4), 55
    look(scene.camera, (0, 0, 0.4))
    waves = painted(
        "waves",
        256,
        128,
        lambda x, y: (0.5 + 0.5 * math.sin(24 * math.pi * x) * math.sin(12 * math.pi * y),) * 3,
        space="Non-Color",
    )
    bent = painted("bent", 128, 64, _tilted_normal_color, space="Non-Color")
    matt = {"Base_Color": (0.7, 0.65, 0.6, 1), "Specular_IOR_Level": 0.0}

    def bump(strength: float, distance: float, inverted: bool = False):
        def build(tree, source):
            return _new(
                tree, "ShaderNodeBump", {"Strength": strength, "Distance": distance}, source, "Height", 0, invert=inverted
            )

        return build

    def normals(strength: float):
        return lambda tree, source: _new(tree, "ShaderNodeNormalMap", {"Strength": strength}, source, "Color", 0)

    high = [bump(1.0, 0.03), bump(0.5, 0.03), bump(1.0, 0.03, True), bump(1.0, 0.01)]
    _row([_textured_material(f"bump {i}", build, waves, "Normal", **matt) for i, build in enumerate(high)], 0.8)
    low = [normals(1.0), normals(0.5)]
    _row([_textured_material(f"normals {i}", build, bent, "Normal", **matt) for i, build in enumerate(low)], -0.5)
    return scene


def _tilted_normal_color(x: float, y: float) -> tuple[float, float, float]:
    """Returns the colour at x, y of a test normal map, whose normals are tilted to alternating sides."""
    a, b = 0.5 * math.sin(20 * math.pi * x), 0.4 * math.cos(14 * math.pi * y)
    length = math.sqrt(a * a + b * b + 1)
    return 0.5 + 0.5 * a / length, 0.5 + 0.5 * b / length, 0.5 + 0.5 / length


def surroundings() -> bpy.types.Scene:
    """Returns a scene under a rotated environment image, whose objects have textures, alpha and bump maps."""
    scene = empty()
    node = world_node(scene, "ShaderNodeTexEnvironment")
    node.image = painted("sky", 64, 32, lambda x, y: (0.2 + 2 * (0.1 < x < 0.35) * y, 0.3 + y, 0.4 + 0.8 * (x > 0.6)), True)
    tree = scene.world.node_tree
    mapping, at = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Rotation"].default_value[2] = 0.8
    tree.links.new(at.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])
    floor = principled("floor", Roughness=0.9)
    textured(
        floor, painted("tiles", 16, 16, lambda x, y: (0.1 + 0.8 * x, 0.7 * y, 0.3 * (int(x * 4) + int(y * 4)) % 2)), "Base Color"
    )
    add("plane", floor, size=8)
    mirror = principled("mirror", Base_Color=(0.9, 0.9, 0.9, 1), Metallic=1, Roughness=0.15)
    add("uv_sphere", mirror, location=(-1.2, -0.3, 0.9), radius=0.8)
    rough = principled("spotted", Base_Color=(0.3, 0.5, 0.8, 1), Metallic=0.8)
    spots = painted("spots", 8, 8, lambda x, y: (0.3 + 0.6 * (x > 0.5),) * 3, space="Non-Color")
    textured(rough, spots, "Roughness", None)
    add("cube", rough, smooth=False, location=(1.1, 0.3, 0.6), size=1.2)
    seen_through = principled("veil", Base_Color=(0.8, 0.2, 0.1, 1), Roughness=1.0, Alpha=0.4)
    add("plane", seen_through, location=(0.6, -1.6, 0.8), size=1.5, rotation=(1.2, 0, 0.5))
    glass = principled("glass", Base_Color=(1, 1, 1, 1), Roughness=0.0, Transmission_Weight=1.0, IOR=1.4)
    add("uv_sphere", glass, location=(-0.5, -1.9, 0.5), radius=0.45, segments=48, ring_count=32)
    return scene


def moving() -> bpy.types.Scene:
    """Returns a scene with motion blur of objects' transforms, of a shape key, and of the camera."""
    scene = empty()
    table(scene)
    lamp("AREA", 400.0, (2, -3, 5), size=2.0)
    cube, ball = bpy.data.objects["Cube"], bpy.data.objects["Sphere"]
    for frame, x, turn in ((1, 1.1, 0.0), (3, 0.1, 1.2)):
        cube.location[0], cube.rotation_euler[2] = x, turn
        cube.keyframe_insert("location", frame=frame)
        cube.keyframe_insert("rotation_euler", frame=frame)
        scene.camera.location[2] = 3.2 + 0.1 * frame
        scene.camera.keyframe_insert("location", frame=frame)
    ball.shape_key_add(name="Basis")
    fat = ball.shape_key_add(name="fat")
    for key, vertex in zip(fat.data, ball.data.vertices, strict=True):
        key.co = vertex.co * 1.6
    for frame, value in ((1, 0.0), (3, 1.0)):
        fat.value = value
        fat.keyframe_insert("value", frame=frame)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    for thing in scene.objects:
        thing.cycles.use_motion_blur = thing.cycles.use_deform_motion = True
    return scene
