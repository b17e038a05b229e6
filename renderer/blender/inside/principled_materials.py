"""Converts materials to a form that the glTF exporter supports: a single Principled BSDF with at most one image per input.

The add-on's modules do the conversion. Without them, materials are unchanged.
"""

from __future__ import annotations

import importlib
import sys
import types
from pathlib import Path
from typing import Any, NamedTuple

from .exporter_support import is_placed_by_uv, is_supported
from .sentences import Sentence
from .texture_spaces import has_required_encoding

__all__ = ["Extensions", "modules_of", "simplify"]

VECTOR_INPUTS = {"Normal", "Coat Normal", "Tangent", "Weight"}  # vector inputs, which no colour image represents
NORMAL_INPUTS = {"Normal", "Coat Normal"}
MODULES = (
    "cycles",
    "cycles_differences",
    "displacement",
    "fibres",
    "image_nodes",
    "lights",
    "meshes",
    "nodes",
    "particles",
    "shader_mix",
    "skies",
    "subsurface",
)  # of the add-on's folder `scene`
GLASS, LEAST_IOR = 1.5, 1e-4


Extensions = dict[str, dict[str, Any]]


class _ImageMapping(NamedTuple):
    """The mapping of an image: node and socket of its coordinates, wrap mode, filter, scale, offset and rotation."""

    node: str
    socket: str
    extension: str
    interpolation: str
    scale: tuple[float, float]
    offset: Any = None  # for procedural patterns, which the painter evaluates
    rotation: Any = None


def simplify(bpy: Any, objects: list[Any], addon: Path | None, notes: list[str]) -> Extensions:
    """Converts the materials of objects; returns material name -> properties that the exporter cannot write.

    addon: the folder of the package rayfarm_addon; None if not available: nothing is converted.
    """
    said: Extensions = {}
    if addon is None:
        return said
    modules = modules_of(addon)
    owners: dict[str, Any] = {}
    for thing in objects:
        for slot in thing.material_slots:
            if slot.material is not None:
                owners.setdefault(slot.material.name, (slot.material, thing))
    for material, thing in owners.values():
        if material.use_nodes and material.node_tree is not None and material.library is None:
            found = _Simplifier(bpy, material, thing, modules, notes).run()
            if found:
                said[material.name] = found
    return said


def modules_of(addon: Path) -> Any:
    """Imports the add-on's modules of shaders and hair without registering the add-on. addon: the folder of its package."""
    package = "rayfarm_addon.scene"
    if package not in sys.modules:
        for name, path in (("rayfarm_addon", addon), (package, addon / "scene"), ("rayfarm_addon.farm", addon / "farm")):
            module = types.ModuleType(name)
            module.__path__ = [str(path)]
            sys.modules[name] = module
    return types.SimpleNamespace(**{name: importlib.import_module(f"{package}.{name}") for name in MODULES})


class _Simplifier:
    def __init__(self, bpy: Any, material: Any, thing: Any, modules: Any, notes: list[str]) -> None:
        self._bpy, self._material, self._thing, self._tree = bpy, material, thing, material.node_tree
        self._modules, self._notes = modules, notes
        self._painter = modules.image_nodes.Painter(material.name, self._texture_path)

    def run(self) -> dict[str, Any]:
        """Converts the material if necessary; returns the properties that the exporter cannot write, for `write_extensions`."""
        nodes = self._modules.nodes
        source = nodes.output_of(self._tree)
        output = self._tree.get_output_node("CYCLES") or self._tree.get_output_node("ALL")
        if output is None:
            return {}
        told: list[str] = []
        if source is None or source.node.type in ("EMISSION", "HOLDOUT"):
            inside = self._volume_extension(False, told)
            self._add_notes(told)
            return inside
        self._modules.cycles_differences.warn_of_pictures(self._tree, told.append)
        self._modules.cycles.warn_of_material(self._material, told.append)
        look = self._modules.shader_mix.principled_look(source, told.append)
        if look is None:
            return {}
        through = nodes.constant_value(look.input("Transmission Weight"))
        is_fed = through is None and look.input("Transmission Weight") is not None
        inside = self._volume_extension(is_fed or (isinstance(through, float) and through > 0), told)
        is_own = source.node.type == "BSDF_PRINCIPLED" and not source.groups
        principled = source.node if is_own else self._replace_shader(output)
        shines = self._combine_emission(principled, look)
        for entry in list(principled.inputs):
            if entry.type == "SHADER" or entry.name in shines:
                continue
            at = look.input(entry.name)
            if entry.name in NORMAL_INPUTS and self._convert_bump(entry, at):
                continue
            if entry.name in VECTOR_INPUTS and is_own:
                continue
            if at is not None:
                self._set(entry, at, is_own)
        moved = self._convert_displacement(principled, told)
        self._add_notes(told)
        return self._extensions(look) | inside | moved

    def _add_notes(self, sentences: list[str]) -> None:
        self._notes += [
            Sentence("blend-material", "Material {material}: {note}", material=self._material.name, note=sentence)
            for sentence in dict.fromkeys(sentences)
        ]

    def _volume_extension(self, lets_in: bool, notes: list[str]) -> dict[str, Any]:
        """Returns the glTF extension with the medium of the material's volume; empty if it has no volume.

        lets_in: whether the surface transmits light. notes: receives notes on what is ignored.
        """
        found = self._modules.subsurface.filled(self._tree, lets_in, notes.append)
        return {} if found is None else {self._modules.subsurface.MEDIUM: found}

    def _combine_emission(self, principled: Any, surface: Any) -> tuple[str, ...]:
        """Multiplies images of emission colour and strength into one; returns the names of the material inputs that were set."""
        nodes = self._modules.nodes
        names = ("Emission Color", "Emission Strength")
        color, strength = (surface.input(name) for name in names)
        if color is None or strength is None or nodes.constant_value(strength) is not None:
            return ()
        painted = self._painter.paint(nodes.Product(color, strength), "emission")
        entry, power = (principled.inputs[name] for name in names)
        if painted is None:
            self._notes.append(
                Sentence(
                    "blend-emission-strength-nodes",
                    "Material {material}: nodes of its emission strength are ignored",
                    material=self._material.name,
                )
            )
            return ()
        if isinstance(painted, list):
            self._set_input(entry, painted)
            self._set_input(power, 1.0)
        else:
            self._set_input(power, painted[0].scale_down())
            self._tree.links.new(self._add_image_node(entry, *painted), entry)
        return names

    def _extensions(self, surface: Any) -> dict[str, Any]:
        def number(name: str, default: float = 0.0) -> float:
            found = self._modules.nodes.constant_value(surface.input(name))
            return float(found) if isinstance(found, float) else default

        said: dict[str, Any] = {}
        if (fibres := self._modules.fibres.hair(surface)) is not None:
            said[self._modules.fibres.HAIR] = fibres
        if (beneath := self._modules.subsurface.subsurface(surface)) is not None:
            said[self._modules.subsurface.SUBSURFACE] = beneath
        if (weight := number("Translucent Weight")) > 0:
            color = self._modules.nodes.constant_value(surface.input("Translucent Color"))
            said["KHR_materials_diffuse_transmission"] = {
                "diffuseTransmissionFactor": min(weight, 1.0),
                "diffuseTransmissionColorFactor": [min(max(c, 0.0), 1.0) for c in color or [0.8] * 3],
            }
        ior, is_glass = number("IOR", 1.5), number("Transmission Weight") > 0
        if abs(ior - GLASS) > LEAST_IOR:  # the exporter writes an index of refraction for glass only
            said["KHR_materials_ior"] = {"ior": max(ior, 1.0)}
        if is_glass and ior <= 1.0:
            said["KHR_materials_ior"] = {"ior": 1.0}
        if (left := self._modules.shader_mix.under_coat(surface)) is not None:
            said["baseColorFactor"] = left
        strength, roughness = number("Anisotropic"), number("Roughness", -1.0)
        if strength > 0 and roughness >= 0:
            rough, stretched = self._modules.shader_mix.brushed(strength, roughness, number("Anisotropic Rotation"))
            said |= {"roughnessFactor": rough, "KHR_materials_anisotropy": stretched}
        if (thickness := number("Thin Film Thickness")) > 0 and self._modules.cycles_differences.has_film(surface):
            said["KHR_materials_iridescence"] = {
                "iridescenceFactor": 1.0,
                "iridescenceIor": min(max(number("Thin Film IOR", 1.33), 1.0), 5.0),
                "iridescenceThicknessMinimum": thickness,
                "iridescenceThicknessMaximum": thickness,
            }
        return said

    def _replace_shader(self, output: Any) -> Any:
        """Replaces the material's surface shader by a new Principled BSDF, and returns it."""
        node = self._tree.nodes.new("ShaderNodeBsdfPrincipled")
        self._tree.links.new(node.outputs[0], output.inputs["Surface"])
        return node

    def _set(self, entry: Any, socket: Any, is_own: bool) -> None:
        nodes = self._modules.nodes
        plain = nodes.constant_value(socket)
        if plain is not None:
            self._set_input(entry, plain)
            return
        source = nodes.source_of(socket)[0]
        if (
            source is not None
            and not source.groups
            and is_supported(source.node)
            and has_required_encoding(entry, source.node, source.output)
        ):
            if not is_own:
                self._tree.links.new(source.output, entry)
            return
        if entry.name in VECTOR_INPUTS:
            return
        if entry.name in self._modules.cycles_differences.NUMBERS:
            self._set_input(entry, entry.default_value)
            return
        painted = self._painter.paint(socket, entry.name.lower())
        if isinstance(painted, list):
            self._set_input(entry, painted)
        elif painted is not None:
            self._tree.links.new(self._add_image_node(entry, *painted), entry)

    def _convert_bump(self, entry: Any, socket: Any) -> bool:
        """Replaces a Bump node with a height image by a normal map on the input `entry`; returns False if there is no such node.

        socket: the source of the input in the principled look.
        """
        nodes = self._modules.nodes
        source = nodes.source_of(socket)[0]
        if source is None or source.node.type != "BUMP" or nodes.source_of(source.input("Normal"))[0] is not None:
            return False
        return self._replace_bump([entry], source)

    def _convert_displacement(self, principled: Any, notes: list[str]) -> dict[str, Any]:
        """Converts displacement, if the material has no other bump or normal map: to one, or to one that moves the surface.

        Returns the extension of the latter, without its texture. notes: receives notes.
        """
        scale = abs(self._thing.matrix_world.determinant()) ** (1 / 3)
        heights = self._modules.displacement.displaced(self._material, self._tree, scale, notes.append)
        if heights is None:
            return {}
        normal, coat = (principled.inputs.get(name) for name in ("Normal", "Coat Normal"))
        if normal.is_linked:
            notes.append(
                Sentence(
                    "blend-displacement-and-normals", "its displacement is left out, since it has another bump or normal map"
                )
            )
        elif heights.moves and (moved := self._moved_surface(normal, heights)) is not None:
            return {self._modules.displacement.DISPLACEMENT: moved}
        elif heights.moves or not self._replace_bump([normal] if coat is None or coat.is_linked else [normal, coat], heights):
            notes.append(
                Sentence("blend-displacement-not-by-uvs", "its displacement is left out; only that by UV-mapped images is shown")
            )
        return {}

    def _moved_surface(self, normal: Any, heights: Any) -> dict[str, Any] | None:
        """Returns the extension of a displacement that moves the surface; None if its heights are not an image.

        The image is linked to the material's input `normal`, so that the exporter writes its mapping; `write_extensions` moves it
        from there. "png" has its pixels with 16 bits, since the exporter has 8.
        """
        painted, numbers = self._painter.paint(heights.input("Height"), "height"), heights.parameters(1.0)
        if painted is None or isinstance(painted, list) or numbers is None:
            return None
        node = self._tree.nodes.new("ShaderNodeNormalMap")
        image, way = painted
        self._tree.links.new(self._add_image_node(node.inputs["Color"], image, way, is_color=False), node.inputs["Color"])
        self._tree.links.new(node.outputs["Normal"], normal)
        texels = image.texels.clip(0, 1) * 65535 + 0.5
        return {**numbers, "png": sys.modules["rayfarm_addon.scene.images"].png(texels.astype("uint16"))}

    def _replace_bump(self, entries: list[Any], source: Any) -> bool:
        """Replaces a Bump node by a normal map on these inputs; returns False if its height is not an image."""
        numbers = [self._modules.nodes.constant_value(source.input(name)) for name in ("Strength", "Distance")]
        spans = _length_per_uv_unit(self._thing, self._modules.meshes.spans)
        if spans is None or not all(isinstance(each, float) for each in numbers):
            return False
        strength, distance = numbers
        bump = self._modules.image_nodes.Bump(min(max(strength, 0.0), 1.0), -distance if source.node.invert else distance)

        def length(texture_path: _ImageMapping) -> tuple[float, float] | None:
            return (
                None
                if 0 in texture_path.scale
                else (spans[0] / abs(texture_path.scale[0]), spans[1] / abs(texture_path.scale[1]))
            )

        found = self._painter.bumps(source.input("Height"), bump, length)
        if found is None:
            return False
        node = self._tree.nodes.new("ShaderNodeNormalMap")
        painted, way = found
        self._tree.links.new(self._add_image_node(node.inputs["Color"], painted, way, is_color=False), node.inputs["Color"])
        for entry in entries:
            self._tree.links.new(node.outputs["Normal"], entry)
        return True

    def _set_input(self, entry: Any, value: Any) -> None:
        for link in list(entry.links):
            self._tree.links.remove(link)
        if entry.type == "RGBA":
            entry.default_value = (*(value if isinstance(value, list) else [value] * 3), 1.0)
        elif entry.type == "VALUE":
            entry.default_value = sum(value) / len(value) if isinstance(value, list) else value

    def _add_image_node(self, entry: Any, painted: Any, texture_path: _ImageMapping, is_color: bool | None = None) -> Any:
        """Creates an Image Texture node for an image computed from nodes; returns the node's colour output.

        The node has the mapping of the source images. is_color: whether the image is sRGB-encoded; None: if the input `entry` is
        a colour.
        """
        height, width = painted.texels.shape[:2]
        is_color = entry.type == "RGBA" if is_color is None else is_color
        image = self._bpy.data.images.new(painted.name[:60], width, height, alpha=False, float_buffer=False)
        image.colorspace_settings.name = "sRGB" if is_color else "Non-Color"
        texels = painted.texels.clip(0, 1).copy()
        if is_color:
            texels[..., :3] = sys.modules["rayfarm_addon.scene.images"].to_srgb(texels[..., :3])
        image.pixels.foreach_set(texels[::-1].ravel())
        image.pack()
        node = self._tree.nodes.new("ShaderNodeTexImage")
        node.image, node.extension, node.interpolation = image, texture_path.extension, texture_path.interpolation
        if texture_path.node:
            where = self._tree.nodes[texture_path.node].outputs[texture_path.socket]
            self._tree.links.new(where, node.inputs["Vector"])
        return node.outputs["Color"]

    def _texture_path(self, source: Any) -> _ImageMapping | None:
        node = source.node
        if node.type != "TEX_IMAGE" or node.projection != "FLAT" or source.groups:
            return None
        found, _ = self._modules.nodes.source_of(source.input("Vector"))
        if found is None:
            return _ImageMapping("", "", node.extension, node.interpolation, (1.0, 1.0))
        if found.groups or not is_placed_by_uv(node):
            return None
        scale = (1.0, 1.0)
        if found.node.type == "MAPPING":
            told = self._modules.nodes.constant_value(found.input("Scale"))
            scale = (0.0, 0.0) if told is None else (told[0], told[1])
        return _ImageMapping(found.node.name, found.output.identifier, node.extension, node.interpolation, scale)


def _length_per_uv_unit(thing: Any, spans: Any) -> tuple[float, float] | None:
    """Returns the length of an object's surface per UV unit, across and up; None without UVs.

    spans: `meshes.spans` of the add-on.
    """
    import numpy as np

    mesh = thing.data
    layers = getattr(mesh, "uv_layers", None)
    if not layers:
        return None
    layer = next((each for each in layers if each.active_render), layers[0])
    mesh.calc_loop_triangles()
    loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    corner, co, uv = np.empty(len(mesh.loops), np.int32), np.empty(3 * len(mesh.vertices)), np.empty(2 * len(mesh.loops))
    mesh.loops.foreach_get("vertex_index", corner)
    mesh.vertices.foreach_get("co", co)
    layer.uv.foreach_get("vector", uv)
    loops = loops.reshape(-1, 3)[:20_000]
    at, laid = co.reshape(-1, 3)[corner[loops]], uv.reshape(-1, 2)[loops]
    found = spans(at, laid)
    scale = abs(thing.matrix_world.determinant()) ** (1 / 3)
    return None if found is None else (found[0] * scale, found[1] * scale)
