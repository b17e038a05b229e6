"""The materials that exported_kit.py exports: each function modifies a ball's material. Run by a Python that has bpy."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "blender"))
from blender_scenes import add, background, empty, look, painted, principled

SKY = (0.5, 0.55, 0.6)
SHADER = "Principled BSDF"
RED, GOLD, WHITE = (0.7, 0.1, 0.08, 1), (1.0, 0.77, 0.34, 1), (1, 1, 1, 1)
MATERIALS: dict[str, Callable[[Any], None]] = {}


def material(build: Callable[[Any], None]) -> Callable[[Any], None]:
    """Registers a material of the test. `build` modifies the ball's material, which is initially a plain principled BSDF."""
    MATERIALS[build.__name__] = build
    return build


def stage() -> Any:
    """Returns a ball with one UV set on a floor, below two emissive panels and a uniform sky."""
    scene = empty()
    background(scene).inputs["Color"].default_value = (*SKY, 1)
    add("plane", principled("floor", Base_Color=(0.5, 0.5, 0.5, 1), Roughness=1.0), size=14)
    for name, color, strength, place, size in (
        ("warm", (1, 0.9, 0.75, 1), 8.0, (-1.6, -1.6, 3.2), 1.6),
        ("cool", (0.6, 0.8, 1, 1), 5.0, (2.4, -0.4, 1.8), 0.9),
    ):
        black = principled(name, Base_Color=(0, 0, 0, 1), Roughness=1.0, Emission_Color=color, Emission_Strength=strength)
        look(add("plane", black, size=size, location=place), (0, 0, 1))
    ball = add(
        "uv_sphere",
        principled("ball", Base_Color=(0.8, 0.8, 0.8, 1)),
        location=(0, 0, 1),
        radius=1,
        segments=96,
        ring_count=48,
        rotation=(0, 0, 0.6),
    )
    scene.camera.location, scene.camera.data.angle = (0, -6, 2.6), math.radians(32)
    look(scene.camera, (0, 0, 0.95))
    return ball


def set_to(ball: Any, **values: Any) -> Any:
    """Sets inputs of the ball's principled BSDF (keywords: socket names, with _ for spaces); returns the material's node tree."""
    tree = ball.data.materials[0].node_tree
    for key, value in values.items():
        tree.nodes[SHADER].inputs[key.replace("_", " ")].default_value = value
    return tree


def squares(name: str, seed: int, space: str, columns: int = 8, rows: int = 4, alpha: bool = False) -> Any:
    """Returns an image of `columns` by `rows` squares of random colours. space: colour space."""
    codes = np.random.default_rng(seed).integers(20, 250, (rows, columns, 4)) / 255
    image = bpy.data.images.new(name, columns * 16, rows * 16, alpha=alpha)
    image.colorspace_settings.name = space
    pixels = codes.repeat(16, 0).repeat(16, 1).astype(np.float32)
    if not alpha:
        pixels[..., 3] = 1
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def image_node(tree: Any, image: Any, **values: Any) -> Any:
    """Returns an image texture node with this image."""
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    for key, value in values.items():
        setattr(node, key, value)
    return node


def link(tree: Any, output: Any, socket: str) -> None:
    tree.links.new(output, tree.nodes[SHADER].inputs[socket])


@material
def matt(ball: Any) -> None:
    set_to(ball, Base_Color=RED, Roughness=1.0)


@material
def plastic(ball: Any) -> None:
    set_to(ball, Base_Color=RED, Roughness=0.2, IOR=1.45)


@material
def high_ior(ball: Any) -> None:
    set_to(ball, Base_Color=RED, Roughness=0.25, IOR=2.2)


@material
def metal(ball: Any) -> None:
    set_to(ball, Base_Color=GOLD, Roughness=0.25, Metallic=1.0)


@material
def packed_metal(ball: Any) -> None:
    """Sets roughness and metallic to channels of one image."""
    tree = set_to(ball, Base_Color=GOLD)
    parts = tree.nodes.new("ShaderNodeSeparateColor")
    image = squares("packed", 1, "Non-Color")
    pixels = np.array(image.pixels[:]).reshape(-1, 4)
    pixels[:, 2] = pixels[:, 2] > 0.5
    image.pixels.foreach_set(pixels.ravel().astype(np.float32))
    image.pack()
    tree.links.new(image_node(tree, image).outputs["Color"], parts.inputs[0])
    link(tree, parts.outputs["Green"], "Roughness")
    link(tree, parts.outputs["Blue"], "Metallic")


@material
def coat(ball: Any) -> None:
    set_to(ball, Base_Color=RED, Roughness=0.6, Metallic=1.0, Coat_Weight=1.0, Coat_Roughness=0.05)


@material
def coat_textured(ball: Any) -> None:
    tree = set_to(ball, Base_Color=RED, Roughness=0.9)
    parts = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(image_node(tree, squares("coat", 2, "Non-Color")).outputs["Color"], parts.inputs[0])
    link(tree, parts.outputs["Red"], "Coat Weight")
    link(tree, parts.outputs["Green"], "Coat Roughness")


@material
def sheen(ball: Any) -> None:
    set_to(ball, Base_Color=(0.2, 0.05, 0.3, 1), Roughness=1.0, Sheen_Weight=0.8, Sheen_Tint=(0.9, 0.8, 1, 1))
    set_to(ball, Sheen_Roughness=0.5, Specular_IOR_Level=0.0)


@material
def glass(ball: Any) -> None:
    set_to(ball, Base_Color=WHITE, Roughness=0.0, Transmission_Weight=1.0, IOR=1.5)
    thick(ball, 1.0)


@material
def rough_glass(ball: Any) -> None:
    set_to(ball, Base_Color=WHITE, Roughness=0.4, Transmission_Weight=1.0, IOR=1.5)
    thick(ball, 1.0)


@material
def absorbing_glass(ball: Any) -> None:
    """Sets a glass with an absorbing volume.

    Blender's exporter writes the absorption as the colour that white light has after a distance.
    """
    tree = set_to(ball, Base_Color=WHITE, Roughness=0.0, Transmission_Weight=1.0, IOR=1.5)
    thick(ball, 1.0)
    volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
    volume.inputs["Color"].default_value, volume.inputs["Density"].default_value = (0.2, 0.7, 0.9, 1), 0.8
    tree.links.new(volume.outputs[0], tree.nodes["Material Output"].inputs["Volume"])


def thick(ball: Any, depth: float) -> None:
    """Adds the node group from which Blender's exporter takes a mesh's thickness. depth: the thickness."""
    group = bpy.data.node_groups.new("glTF Material Output", "ShaderNodeTree")
    for name in ("Occlusion", "Thickness"):
        group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketFloat")
    group.nodes.new("NodeGroupInput")
    node = ball.data.materials[0].node_tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    node.inputs["Thickness"].default_value = depth


@material
def transmission_textured(ball: Any) -> None:
    tree = set_to(ball, Base_Color=(0.9, 0.9, 0.6, 1), Roughness=0.1, IOR=1.3)
    thick(ball, 1.0)
    parts = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(image_node(tree, squares("through", 3, "Non-Color")).outputs["Color"], parts.inputs[0])
    link(tree, parts.outputs["Red"], "Transmission Weight")


@material
def emission(ball: Any) -> None:
    """Sets emission of strength above 1, coloured by an image."""
    tree = set_to(ball, Base_Color=(0.1, 0.1, 0.1, 1), Emission_Strength=4.0)
    link(tree, image_node(tree, squares("shine", 4, "sRGB", 6, 3)).outputs["Color"], "Emission Color")


@material
def specular_tint(ball: Any) -> None:
    set_to(ball, Base_Color=RED, Roughness=0.2, Specular_IOR_Level=0.4, Specular_Tint=(0.3, 0.6, 1.0, 1))


@material
def specular_textured(ball: Any) -> None:
    tree = set_to(ball, Base_Color=(0.05, 0.05, 0.05, 1), Roughness=0.2)
    link(tree, image_node(tree, squares("tint", 5, "sRGB")).outputs["Color"], "Specular Tint")


@material
def anisotropy(ball: Any) -> None:
    tree = set_to(ball, Base_Color=GOLD, Roughness=0.4, Metallic=1.0, Anisotropic=0.4, Anisotropic_Rotation=0.1)
    tangent = tree.nodes.new("ShaderNodeTangent")
    tangent.direction_type, tangent.uv_map = "UV_MAP", ball.data.uv_layers[0].name
    link(tree, tangent.outputs[0], "Tangent")


@material
def alpha_blend(ball: Any) -> None:
    tree = set_to(ball)
    node = image_node(tree, squares("veil", 6, "sRGB", alpha=True))
    link(tree, node.outputs["Color"], "Base Color")
    link(tree, node.outputs["Alpha"], "Alpha")


@material
def alpha_constant(ball: Any) -> None:
    set_to(ball, Base_Color=RED, Alpha=0.4)


@material
def alpha_mask(ball: Any) -> None:
    tree = set_to(ball)
    node, above = image_node(tree, squares("holes", 7, "sRGB", alpha=True)), tree.nodes.new("ShaderNodeMath")
    above.operation, above.inputs[1].default_value = "GREATER_THAN", 0.4
    link(tree, node.outputs["Color"], "Base Color")
    tree.links.new(node.outputs["Alpha"], above.inputs[0])
    link(tree, above.outputs[0], "Alpha")


@material
def texture(ball: Any) -> None:
    """Sets the base colour to the product of an image and a colour."""
    tree = set_to(ball, Roughness=0.7)
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type, mix.inputs[0].default_value = "RGBA", "MULTIPLY", 1.0
    mix.inputs[7].default_value = (0.9, 0.6, 0.8, 1)
    tree.links.new(image_node(tree, squares("color", 8, "sRGB")).outputs["Color"], mix.inputs[6])
    link(tree, mix.outputs[2], "Base Color")


@material
def texture_transform(ball: Any) -> None:
    tree = set_to(ball, Roughness=0.7)
    node, mapping = image_node(tree, squares("turned", 9, "sRGB")), tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Location"].default_value = (0.1, 0.3, 0)
    mapping.inputs["Rotation"].default_value[2] = 0.5
    mapping.inputs["Scale"].default_value = (1.5, 0.7, 1)
    at = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(at.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], node.inputs["Vector"])
    link(tree, node.outputs["Color"], "Base Color")


@material
def texture_mirrored(ball: Any) -> None:
    """Sets the base colour to an image that is mirrored at each repetition, and is read without filtering."""
    tree = set_to(ball, Roughness=0.7)
    node = image_node(tree, squares("mirrored", 10, "sRGB", 3, 3), extension="MIRROR", interpolation="Closest")
    mapping, at = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Scale"].default_value = (4, 3, 1)
    tree.links.new(at.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], node.inputs["Vector"])
    link(tree, node.outputs["Color"], "Base Color")


@material
def normal_map(ball: Any) -> None:
    def bumps(x: float, y: float) -> tuple[float, float, float]:
        n = (0.3 * math.cos(8 * math.pi * x), 0.2 * math.cos(6 * math.pi * y), 1.0)
        length = math.hypot(*n)
        return n[0] / length / 2 + 0.5, n[1] / length / 2 + 0.5, n[2] / length / 2 + 0.5

    tree = set_to(ball, Base_Color=(0.6, 0.6, 0.7, 1), Roughness=0.4)
    node, bend = image_node(tree, painted("bumps", 64, 64, bumps, space="Non-Color")), tree.nodes.new("ShaderNodeNormalMap")
    bend.inputs["Strength"].default_value = 0.7
    tree.links.new(node.outputs["Color"], bend.inputs["Color"])
    link(tree, bend.outputs[0], "Normal")


@material
def two_sets(ball: Any) -> None:
    """Sets the base colour to an image mapped by the second UV set, and the roughness to one mapped by the first."""
    first, second = ball.data.uv_layers[0], ball.data.uv_layers.new(name="second")
    for one, other in zip(first.data, second.data, strict=True):
        other.uv = (one.uv[1] * 2, one.uv[0])
    first.active = first.active_render = True
    tree = set_to(ball)
    node, at = image_node(tree, squares("by second", 11, "sRGB")), tree.nodes.new("ShaderNodeUVMap")
    at.uv_map = "second"
    tree.links.new(at.outputs[0], node.inputs["Vector"])
    link(tree, node.outputs["Color"], "Base Color")
    rough, at = image_node(tree, squares("by first", 12, "Non-Color")), tree.nodes.new("ShaderNodeUVMap")
    at.uv_map = first.name
    tree.links.new(at.outputs[0], rough.inputs["Vector"])
    link(tree, rough.outputs["Color"], "Roughness")


@material
def vertex_colors(ball: Any) -> None:
    tree = set_to(ball, Roughness=0.8)
    colors = ball.data.color_attributes.new("shade", "FLOAT_COLOR", "POINT")
    for vertex, color in zip(ball.data.vertices, colors.data, strict=True):
        color.color = (*(0.5 + 0.45 * c for c in vertex.co), 1)
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "shade"
    link(tree, node.outputs["Color"], "Base Color")


@material
def thin_film(ball: Any) -> None:
    set_to(ball, Base_Color=(0.1, 0.1, 0.1, 1), Roughness=0.2, IOR=1.5, Thin_Film_Thickness=420.0, Thin_Film_IOR=2.0)


@material
def unlit(ball: Any) -> None:
    tree = set_to(ball)
    node = tree.nodes.new("ShaderNodeBackground")
    node.inputs["Color"].default_value = (0.3, 0.5, 0.2, 1)
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


@material
def nodes(ball: Any) -> None:
    """Sets base colour and roughness by an RGB and a Value node."""
    tree = set_to(ball)
    color, value = tree.nodes.new("ShaderNodeRGB"), tree.nodes.new("ShaderNodeValue")
    color.outputs[0].default_value, value.outputs[0].default_value = RED, 0.3
    link(tree, color.outputs[0], "Base Color")
    link(tree, value.outputs[0], "Roughness")


@material
def open_shell(ball: Any) -> None:
    """Deletes half of the ball, so that its inside is visible."""
    set_to(ball, Base_Color=(0.2, 0.5, 0.7, 1), Roughness=0.5)
    mesh = ball.data
    keep = [p for p in mesh.polygons if p.center.y > -0.35]
    faces = [tuple(p.vertices) for p in keep]
    half = bpy.data.meshes.new("half")
    half.from_pydata([v.co[:] for v in mesh.vertices], [], faces)
    half.materials.append(mesh.materials[0])
    half.polygons.foreach_set("use_smooth", [True] * len(half.polygons))
    half.update()
    ball.data = half
    ball.rotation_euler = (0, 0, 0)


@material
def bent_colors(ball: Any) -> None:
    """Sets colours by node arithmetic that glTF, FBX and USD cannot represent."""
    tree = set_to(ball)
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value = 2.0
    link(tree, noise.outputs["Color"], "Base Color")
