"""Writes small .blend scenes, each with one feature that was once rendered differently from Cycles, and Cycles' pictures of them.

python blend_features.py FOLDER [NAME...]        run by a Python that has bpy
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "blender"))
from blender_scenes import add, background, empty, lamp, look, painted, principled, world_node

SIZE, SAMPLES, BOUNCES = 64, 128, 12
RED = (0.7, 0.2, 0.1, 1)
SHADER = "Principled BSDF"


def stage(scene: Any, power: float = 300.0, **values: Any) -> tuple[Any, Any]:
    """Builds a ball on a floor with a lamp and a camera; returns (ball, the material's node tree).

    power: of the lamp in watts; 0: no lamp. values: inputs of the ball's principled material.
    """
    add("plane", principled("floor", Base_Color=(0.5, 0.45, 0.4, 1), Roughness=0.9, Specular_IOR_Level=0.0), size=14)
    if power:
        lamp("AREA", power, (2.5, -3.0, 4), size=3.0)
    background(scene).inputs["Strength"].default_value = 0.6
    scene.camera.location, scene.camera.data.lens = (0, -5, 2.2), 50
    look(scene.camera, (0, 0, 0.7))
    material = principled("ball", **{"Base_Color": RED, **values})
    ball = add("uv_sphere", material, location=(0, 0, 0.9), radius=0.9, segments=64, ring_count=32)
    return ball, material.node_tree


def stripes(tree: Any, space: str) -> Any:
    """Returns a new image texture node with an image of stripes, read without filtering. space: the image's colour space."""
    node = tree.nodes.new("ShaderNodeTexImage")
    node.interpolation = "Closest"
    node.image = painted(
        "stripes", 32, 32, lambda x, y: (0.2 + 0.7 * (int(x * 8) % 2), 0.1 + 0.8 * (int(y * 6) % 2), x), space=space
    )
    return node


def grey(tree: Any) -> Any:
    """Returns a new image texture node whose image holds grey data, but is marked as sRGB colour, Blender's default."""
    node = tree.nodes.new("ShaderNodeTexImage")
    node.interpolation = "Closest"
    node.image = painted("numbers", 16, 16, lambda x, y: (0.2 + 0.5 * (int(x * 8) % 2),) * 3)
    return node


def ior(scene: Any) -> None:
    stage(scene, Roughness=0.3, IOR=2.2)


def tinted_glass(scene: Any) -> None:
    stage(scene, Base_Color=(0.9, 0.7, 0.5, 1), Roughness=0.0, Transmission_Weight=1.0, IOR=1.4)


def shining_mask(scene: Any) -> None:
    _, tree = stage(scene, Emission_Color=(1, 0.6, 0.3, 1))
    times = tree.nodes.new("ShaderNodeMath")
    times.operation, times.inputs[1].default_value = "MULTIPLY", 3.0
    tree.links.new(stripes(tree, "Non-Color").outputs[0], times.inputs[0])
    tree.links.new(times.outputs[0], tree.nodes[SHADER].inputs["Emission Strength"])


def spaces(scene: Any) -> None:
    _, tree = stage(scene, Metallic=0.5)
    tree.links.new(stripes(tree, "Non-Color").outputs[0], tree.nodes[SHADER].inputs["Base Color"])
    tree.links.new(grey(tree).outputs[0], tree.nodes[SHADER].inputs["Roughness"])


def mask(scene: Any) -> None:
    """Connects an image's colour output, instead of its alpha, to the opacity of the ball's material."""
    _, tree = stage(scene)
    tree.links.new(stripes(tree, "Non-Color").outputs[0], tree.nodes[SHADER].inputs["Alpha"])


def mapped(scene: Any) -> None:
    _, tree = stage(scene, Roughness=0.8)
    node, mapping, at = stripes(tree, "sRGB"), tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
    mapping.vector_type = "TEXTURE"
    mapping.inputs["Rotation"].default_value[2], mapping.inputs["Scale"].default_value = 0.5, (2, 1.5, 1)
    tree.links.new(at.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], node.inputs["Vector"])
    tree.links.new(node.outputs[0], tree.nodes[SHADER].inputs["Base Color"])


def multiplied(scene: Any) -> None:
    _, tree = stage(scene, Roughness=0.8)
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type, mix.inputs[0].default_value = "RGBA", "MULTIPLY", 0.5
    mix.inputs[7].default_value = (0.2, 0.9, 0.2, 1)
    tree.links.new(stripes(tree, "sRGB").outputs[0], mix.inputs[6])
    tree.links.new(mix.outputs[2], tree.nodes[SHADER].inputs["Base Color"])


def brushed_glossy(scene: Any) -> None:
    _, tree = stage(scene)
    node = tree.nodes.new("ShaderNodeBsdfAnisotropic")
    node.inputs["Color"].default_value, node.inputs["Roughness"].default_value = RED, 0.4
    node.inputs["Anisotropy"].default_value = 0.6
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


def plain(scene: Any) -> None:
    """Builds the stage with a ball that has no material."""
    ball, _ = stage(scene)
    ball.data.materials.clear()


def of_each(scene: Any) -> None:
    """Adds copies of the ball, which share its mesh and have their own object colours, used by the material as base colour."""
    ball, tree = stage(scene, Roughness=0.8)
    node = tree.nodes.new("ShaderNodeObjectInfo")
    tree.links.new(node.outputs["Color"], tree.nodes[SHADER].inputs["Base Color"])
    ball.color = (0.7, 0.6, 0.1, 1)
    for i, color in enumerate(((0.8, 0.1, 0.1, 1), (0.1, 0.7, 0.1, 1), (0.1, 0.1, 0.8, 1))):
        other = ball.copy()
        other.color, other.location, other.scale = color, (i - 1, -1.4, 0.3), (0.35,) * 3
        scene.collection.objects.link(other)


def lamps(scene: Any) -> None:
    """Adds lamps of five kinds: not rendered, instanced twice, a portal, with power per square metre, and with shader nodes."""
    stage(scene, power=0.0)
    lamp("POINT", 500.0, (0, -2, 3)).hide_render = True
    lamp("AREA", 500.0, (0, -2, 3)).data.cycles.is_portal = True
    shown = bpy.data.collections.new("lamps")
    inner = lamp("POINT", 60.0, (0, 0, 0), shadow_soft_size=0.2)
    scene.collection.objects.unlink(inner)
    shown.objects.link(inner)
    for x in (-1.5, 1.5):
        each = bpy.data.objects.new("lamps", None)
        each.instance_type, each.instance_collection, each.location = "COLLECTION", shown, (x, -1.5, 2)
        scene.collection.objects.link(each)
    lamp("POINT", 50.0, (2, -2, 3), normalize=False, shadow_soft_size=0.4)
    warm = lamp("POINT", 100.0, (-2, -2, 3), shadow_soft_size=0.3).data
    warm.use_nodes = True
    tree = warm.node_tree
    body = tree.nodes.new("ShaderNodeBlackbody")
    body.inputs[0].default_value = 3000
    tree.links.new(body.outputs[0], tree.nodes["Emission"].inputs["Color"])


def _shaded(thing: Any) -> Any:
    thing.data.use_nodes = True
    return thing.data.node_tree


def profiles(scene: Any) -> None:
    """Adds a point and a spot light, both rotated, with asymmetric IES profiles: one from a file, one from a text block."""
    stage(scene, power=0.0)
    text = bpy.data.texts.new("lamp.ies")
    angles, planes = range(0, 91, 10), range(0, 361, 30)
    rows = [" ".join(str(800 - 8 * v + 200 * (h % 360 < 100)) for v in angles) for h in planes]
    head = f"IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 {len(angles)} {len(planes)} 1 2 0 0 0\n1 1 100\n"
    text.write(head + " ".join(map(str, angles)) + "\n" + " ".join(map(str, planes)) + "\n" + "\n".join(rows) + "\n")
    for kind, place, turn in (("POINT", (-1.2, -2.0, 2.5), (0.4, 0.3, 0.5)), ("SPOT", (1.5, -1.5, 2.5), (0.3, 0.4, 1.0))):
        size = {"spot_size": 1.6, "spot_blend": 0.3} if kind == "SPOT" else {}
        thing = lamp(kind, 60.0, place, shadow_soft_size=0.0, **size)
        thing.rotation_euler = turn
        tree = _shaded(thing)
        node = tree.nodes.new("ShaderNodeTexIES")
        node.mode, node.ies = "INTERNAL", text
        tree.links.new(node.outputs[0], tree.nodes["Emission"].inputs["Strength"])


def slides(scene: Any) -> None:
    """Adds spot lights that project images, one of them very wide, and a coloured point light."""
    stage(scene, power=0.0, Roughness=0.8)
    for kind, watts, place, turn, size in (
        ("SPOT", 900.0, (1.0, -3.0, 3.5), (0.75, 0.1, 0.4), 0.8),
        ("SPOT", 300.0, (-2.0, -1.0, 2.5), (0.2, -0.5, 0.0), 2.6),
        ("POINT", 80.0, (0.0, -2.5, 1.5), (0.4, 0.0, 0.3), None),
    ):
        thing = lamp(kind, watts, place, shadow_soft_size=0.0, **({"spot_size": size, "spot_blend": 0.2} if size else {}))
        thing.rotation_euler = turn
        tree = _shaded(thing)
        at, node = tree.nodes.new("ShaderNodeTexCoord"), stripes(tree, "sRGB")
        tree.links.new(at.outputs["UV" if kind == "SPOT" else "Normal"], node.inputs["Vector"])
        tree.links.new(node.outputs[0], tree.nodes["Emission"].inputs["Color"])


def sky(scene: Any) -> None:
    """Gives the world a procedural sky, whose sun has an angular size of half a degree."""
    stage(scene, power=0.0, Roughness=0.7)
    node = world_node(scene, "ShaderNodeTexSky")
    node.sky_type, node.sun_elevation, node.sun_rotation = "NISHITA", 0.6, 0.8
    background(scene).inputs["Strength"].default_value = 0.05


def shader(tree: Any, kind: str, into: str, **values: Any) -> Any:
    """Adds a node of this kind to the node tree, and connects it to the input `into` of the material output."""
    node = tree.nodes.new(kind)
    for name, value in values.items():
        node.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs[into])
    return node


def smoke(scene: Any) -> None:
    """Sets a material with a forward-scattering volume and no surface."""
    _, tree = stage(scene)
    tree.nodes.remove(tree.nodes[SHADER])
    shader(tree, "ShaderNodeVolumeScatter", "Volume", Color=(0.9, 0.7, 0.4, 1), Density=1.2, Anisotropy=0.4)


def ink(scene: Any) -> None:
    """Gives the ball a clear surface, and an absorbing volume below the surface."""
    _, tree = stage(scene)
    shader(tree, "ShaderNodeBsdfTransparent", "Surface")
    shader(tree, "ShaderNodeVolumeAbsorption", "Volume", Color=(0.8, 0.4, 0.1, 1), Density=1.5)


def juice(scene: Any) -> None:
    """Sets a glass material with a volume inside."""
    _, tree = stage(scene, Base_Color=(1, 1, 1, 1), Roughness=0.2, Transmission_Weight=1.0, IOR=1.33)
    values = {"Color": (0.6, 0.3, 0.1, 1), "Density": 2.0, "Anisotropy": -0.3, "Absorption_Color": (0.5, 0.2, 0.1, 1)}
    shader(tree, "ShaderNodeVolumePrincipled", "Volume", **values)


def fog(scene: Any) -> None:
    """Gives the world a volume, which hides the background."""
    stage(scene, Roughness=0.7)
    tree = scene.world.node_tree
    node = tree.nodes.new("ShaderNodeVolumeScatter")
    node.inputs["Density"].default_value, node.inputs["Anisotropy"].default_value = 0.08, 0.2
    tree.links.new(node.outputs[0], tree.nodes["World Output"].inputs["Volume"])


def wax(scene: Any) -> None:
    values = {"Subsurface_Weight": 1.0, "Subsurface_Radius": (1.0, 0.5, 0.25), "Subsurface_Scale": 1.5}
    stage(scene, Roughness=0.6, **values)


def skin(scene: Any) -> None:
    values = {"Subsurface_Weight": 0.7, "Subsurface_Radius": (1.0, 0.4, 0.2), "Subsurface_Scale": 0.2}
    _, tree = stage(scene, Base_Color=(0.8, 0.5, 0.35, 1), Roughness=0.6, **values)
    tree.nodes[SHADER].subsurface_method = "RANDOM_WALK_SKIN"


def marble(scene: Any) -> None:
    """Sets a subsurface scattering shader whose colours are those of an image."""
    _, tree = stage(scene)
    values = {"Scale": 1.0, "Radius": (1.0, 1.0, 1.0)}
    node = shader(tree, "ShaderNodeSubsurfaceScattering", "Surface", **values)
    tree.links.new(stripes(tree, "sRGB").outputs[0], node.inputs["Color"])


def dents(scene: Any) -> None:
    """Scales the ball, and gives its material displacement, which Cycles renders as bump mapping only."""
    ball, tree = stage(scene, Roughness=0.5)
    node = tree.nodes.new("ShaderNodeTexImage")

    def wave(x: float, y: float) -> tuple[float, float, float]:
        return (0.5 + 0.25 * math.sin(12 * math.pi * x) + 0.25 * math.cos(8 * math.pi * y),) * 3

    node.image = painted("heights", 256, 128, wave, space="Non-Color")
    displacement = shader(tree, "ShaderNodeDisplacement", "Displacement", Scale=0.1)
    tree.links.new(node.outputs[0], displacement.inputs["Height"])
    ball.scale = (1.1, 1.1, 1.1)


def moved(scene: Any) -> None:
    """Displaces the vertices of a dense grid, at a scale that is not one."""
    ball, tree = stage(scene, Roughness=0.7)
    material = ball.active_material
    bpy.data.objects.remove(ball)
    grid = add("grid", material, x_subdivisions=400, y_subdivisions=400, size=2, location=(0, 0, 0.4))
    grid.data.shade_smooth()
    grid.scale = (1.6, 1.6, 1.6)
    material.displacement_method = "DISPLACEMENT"
    node = tree.nodes.new("ShaderNodeTexImage")

    def wave(x: float, y: float) -> tuple[float, float, float]:
        return (0.5 + 0.25 * math.sin(6 * math.pi * x) + 0.25 * math.cos(4 * math.pi * y),) * 3

    node.image = painted("heights", 256, 128, wave, space="Non-Color")
    displacement = shader(tree, "ShaderNodeDisplacement", "Displacement", Scale=0.15, Midlevel=0.4)
    tree.links.new(node.outputs[0], displacement.inputs["Height"])


def cloud(scene: Any) -> None:
    """Replaces the ball by the points that geometry nodes make of its vertices."""
    ball, _ = stage(scene, Roughness=0.7)
    tree = bpy.data.node_groups.new("points", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    given, points, painted_points, shown = (
        tree.nodes.new(kind)
        for kind in ("NodeGroupInput", "GeometryNodeMeshToPoints", "GeometryNodeSetMaterial", "NodeGroupOutput")
    )
    points.inputs["Radius"].default_value = 0.07
    painted_points.inputs["Material"].default_value = ball.active_material
    tree.links.new(given.outputs[0], points.inputs[0])
    tree.links.new(points.outputs[0], painted_points.inputs[0])
    tree.links.new(painted_points.outputs[0], shown.inputs[0])
    ball.modifiers.new("points", "NODES").node_group = tree


def hair_material(name: str, model: str = "CHIANG", **values: Any) -> Any:
    """Returns a material of Principled Hair by a colour. values: inputs."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node, output = tree.nodes.new("ShaderNodeBsdfHairPrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    node.model, node.parametrization = model, "COLOR"
    for key, value in values.items():
        node.inputs[key.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], output.inputs[0])
    return material


def fur(scene: Any) -> None:
    """Adds particle hair with children to the ball."""
    _add_fur(scene, hair_material("fur", Color=(0.5, 0.3, 0.15, 1), Roughness=0.3, Radial_Roughness=0.4))


def facet_fur(scene: Any) -> None:
    """Adds such hair with the model of Huang, round."""
    _add_fur(scene, hair_material("fur", "HUANG", Color=(0.5, 0.3, 0.15, 1), Roughness=0.3, Aspect_Ratio=1.0))


def elliptic_fur(scene: Any) -> None:
    """Adds such hair whose cross-sections are ellipses."""
    _add_fur(scene, hair_material("fur", "HUANG", Color=(0.5, 0.3, 0.15, 1), Roughness=0.3, Aspect_Ratio=0.7))


def _add_fur(scene: Any, material: Any) -> None:
    ball, _ = stage(scene, Roughness=0.9)
    ball.data.materials.append(material)
    ball.modifiers.new("fur", "PARTICLE_SYSTEM")
    settings = ball.particle_systems[0].settings
    settings.type, settings.count, settings.hair_length, settings.material = "HAIR", 150, 0.5, 2
    settings.child_type, settings.child_percent, settings.rendered_child_count = "INTERPOLATED", 2, 6
    settings.brownian_factor, settings.render_step = 0.05, 4
    settings.radius_scale, settings.root_radius, settings.tip_radius = 0.03, 1.0, 0.3
    scene.cycles_curves.shape = "THICK"


def strands(scene: Any) -> None:
    """Replaces the ball by hair curves."""
    material = hair_material("hair", Color=(0.6, 0.4, 0.2, 1), Roughness=0.5, Radial_Roughness=0.6, Offset=0.05)
    _add_strands(scene, material)


def facet_strands(scene: Any) -> None:
    """Adds round hair curves with the model of Huang."""
    _add_strands(scene, hair_material("hair", "HUANG", Color=(0.6, 0.4, 0.2, 1), Roughness=0.3, Offset=0.05, Aspect_Ratio=1.0))


def elliptic_strands(scene: Any) -> None:
    """Adds hair curves whose cross-sections are ellipses."""
    _add_strands(scene, hair_material("hair", "HUANG", Color=(0.6, 0.4, 0.2, 1), Roughness=0.3, Offset=0.05, Aspect_Ratio=0.7))


def _add_strands(scene: Any, material: Any) -> None:
    ball, _ = stage(scene)
    bpy.data.objects.remove(ball)
    points = [(0.12 * (k % 18 - 9) + 0.2 * math.sin(i + k), 0.12 * (k // 18 - 9), 0.25 * i) for k in range(324) for i in range(8)]
    data = bpy.data.hair_curves.new("strands")
    data.add_curves([8] * 324)
    data.points.foreach_set("position", [each for point in points for each in point])
    data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", [0.02] * len(points))
    data.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("strands", data))
    scene.cycles_curves.shape = "THICK"


SCENES: dict[str, Callable[[Any], None]] = {
    each.__name__: each
    for each in (
        *(ior, tinted_glass, shining_mask, spaces, mask, mapped, multiplied, brushed_glossy),
        *(plain, of_each, lamps, profiles, slides, sky),
        *(smoke, ink, juice, fog, wax, skin, marble, dents, moved, cloud),
        *(fur, strands, facet_fur, elliptic_fur, facet_strands, elliptic_strands),
    )
}


def main(folder: Path, names: list[str]) -> None:
    """Writes the scenes with these names."""
    for name, build in SCENES.items():
        if names and name not in names:
            continue
        scene = empty()
        build(scene)
        render, cycles = scene.render, scene.cycles
        render.engine, render.resolution_x, render.resolution_y = "CYCLES", SIZE, SIZE
        cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", SAMPLES, False, False
        cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
        cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = BOUNCES
        cycles.transparent_max_bounces, cycles.volume_bounces = 64, BOUNCES
        cycles.blur_glossy = cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.light_sampling_threshold = 0.0
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"), copy=True, compress=False)
        render.filepath = str(folder / f"{name}.exr")
        bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2:])
