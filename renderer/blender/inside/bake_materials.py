"""Bakes material inputs that only Blender can evaluate: Cycles renders them to images over UVs that do not overlap."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from .exporter_support import differs_by_object, is_supported, view_dependent_label
from .sentences import Sentence

__all__ = ["bake"]

BAKED = ("Base Color", "Metallic", "Roughness", "Alpha", "Emission Color")
LIT = ("Base Color", "Emission Color")  # inputs that may exceed 1
NORMAL_INPUTS = ("Normal", "Coat Normal")  # inputs whose bumps are baked as normal maps
LAYER = "rayfarm"
SIZE, LEAST_SIZE = 1024, 256
MARGIN = 8  # texels around each island
MOST_FACES = 200_000  # of a material's meshes together: unwrapping them takes about a minute
MOST_THINGS = 100
MOST_LAYERS = 2  # UV sets that the renderer supports
PATIENCE = 120.0  # total time limit of a file's baking, in seconds
SAMPLES = 4


def bake(bpy: Any, scene: Any, objects: list[Any], notes: list[str]) -> None:
    """Replaces the material inputs that the exporter cannot convert by baked images.

    objects: the mesh objects with these materials. notes: receives warnings.
    """
    if "cycles" not in bpy.context.preferences.addons:
        return
    until = time.monotonic() + PATIENCE
    wanted = _materials_to_bake(objects)
    if not wanted:
        return
    before = _settings(scene)
    try:
        for material, entries, owners in wanted:
            if time.monotonic() > until:
                notes.append(
                    Sentence(
                        "blend-bake-timeout",
                        "Baking of material nodes exceeded {seconds} s, so some are not baked; bake them to images in Blender",
                        seconds=round(PATIENCE),
                    )
                )
                break
            told = sorted(
                {view_dependent_label(entry.links[0].from_node, entry.links[0].from_socket.name) for entry in entries} - {""}
            )
            if told:
                notes.append(
                    Sentence(
                        "blend-bake-view-dependent",
                        "Material {material}: {node} depends on the view; it is baked as seen from one place",
                        material=material.name,
                        node=told[0],
                    )
                )
            reason = _reason_not_to_bake(owners)
            if reason:
                notes.append(
                    Sentence(
                        "blend-not-baked",
                        "Material {material}: its nodes are not baked: {reason}",
                        material=material.name,
                        reason=reason,
                    )
                )
                continue
            try:
                _bake_inputs(bpy, scene, material, entries, owners, notes)
            except RuntimeError as error:
                notes.append(
                    Sentence(
                        "blend-bake-failed",
                        "Material {material}: its nodes could not be baked ({error})",
                        material=material.name,
                        error=str(error).strip()[:120],
                    )
                )
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)


def _materials_to_bake(objects: list[Any]) -> list[tuple[Any, list[Any], list[Any]]]:
    """Returns (material, sockets to bake, one object for each mesh that uses it) for each material with such sockets."""
    found: dict[str, tuple[Any, list[Any], list[Any]]] = {}
    seen = set()
    split: list[Any] = []  # objects that shared their meshes with others
    for thing in objects:
        for slot in list(thing.material_slots):
            material = slot.material
            if material is None or not material.use_nodes or material.library is not None:
                continue
            entries = _unsupported_inputs(material)
            is_shared = thing.type == "MESH" and thing.data.users > 1 and len(split) < MOST_THINGS
            if is_shared and any(
                differs_by_object(entry.links[0].from_node, entry.links[0].from_socket.name) for entry in entries
            ):
                thing.data = thing.data.copy()
                split.append(thing)
            if not entries or (material.name, thing.data.name) in seen:
                continue
            seen.add((material.name, thing.data.name))
            found.setdefault(material.name, (material, entries, []))[2].append(thing)
    return [found[name] for name in sorted(found)]


def _unsupported_inputs(material: Any) -> list[Any]:
    """Returns the inputs of the material's Principled BSDF that are connected to nodes the exporter does not support."""
    output = material.node_tree.get_output_node("CYCLES") or material.node_tree.get_output_node("ALL")
    links: Sequence[Any] = output.inputs["Surface"].links if output is not None else ()
    node = links[0].from_node if links else None
    if node is None or node.type != "BSDF_PRINCIPLED":
        return []
    entries = [node.inputs[name] for name in (*BAKED, *NORMAL_INPUTS) if name in node.inputs and node.inputs[name].is_linked]
    return [entry for entry in entries if not is_supported(entry.links[0].from_node)]


def _reason_not_to_bake(owners: list[Any]) -> str:
    """Returns the reason why materials of these objects cannot be baked; empty if they can."""
    if any(thing.type != "MESH" for thing in owners):
        return Sentence("blend-bake-on-curves", "it is on curves or text; convert these to meshes")
    if len(owners) > MOST_THINGS or sum(len(thing.data.polygons) for thing in owners) > MOST_FACES:
        return Sentence("blend-bake-too-large", "its meshes are too many or too large")
    if any(len([layer for layer in thing.data.uv_layers if layer.name != LAYER]) >= MOST_LAYERS for thing in owners):
        return Sentence("blend-bake-uv-maps", "its meshes have two UV maps already")
    return ""


def _settings(scene: Any) -> list[tuple[Any, str, Any]]:
    """Changes render settings of the scene for baking; returns (owner, property, previous value) of each, to restore them."""
    render, cycles = scene.render, scene.cycles
    wanted = [
        (render, "engine", "CYCLES"),
        (cycles, "device", "CPU"),
        (cycles, "samples", SAMPLES),
        (cycles, "use_adaptive_sampling", False),
        (cycles, "use_denoising", False),
        (cycles, "shading_system", False),
        (render.bake, "margin", MARGIN),
        (render.bake, "use_selected_to_active", False),
        (render.bake, "use_clear", True),
        (render.bake, "target", "IMAGE_TEXTURES"),
        (render, "use_simplify", False),
    ]
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in wanted]
    for owner, name, value in wanted:
        setattr(owner, name, value)
    return before


def _bake_inputs(bpy: Any, scene: Any, material: Any, entries: list[Any], owners: list[Any], notes: list[str]) -> None:
    _add_disjoint_uvs(bpy, owners)
    tree = material.node_tree
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    surface = output.inputs["Surface"].links[0].from_socket
    shining = tree.nodes.new("ShaderNodeEmission")
    others = _assign_dummy_images(bpy, material, owners)
    try:
        for entry in entries:
            image = _image(bpy, material, entry, owners)
            target = tree.nodes.new("ShaderNodeTexImage")
            target.image = image
            tree.nodes.active = target
            is_bent = entry.name in NORMAL_INPUTS
            tree.links.new(entry.links[0].from_socket, shining.inputs["Color"])
            tree.links.new(surface if is_bent else shining.outputs[0], output.inputs["Surface"])
            _select(bpy, owners)
            bpy.ops.object.bake(type="NORMAL" if is_bent else "EMIT", normal_space="TANGENT")
            if entry.name in LIT:
                notes += [
                    Sentence("blend-material", "Material {material}: {note}", material=material.name, note=each)
                    for each in [_limit_to_one(image, entry)]
                    if each
                ]
            image.pack()
            where = tree.nodes.new("ShaderNodeUVMap")
            where.uv_map = LAYER
            tree.links.new(where.outputs[0], target.inputs["Vector"])
            if is_bent:
                bends = tree.nodes.new("ShaderNodeNormalMap")
                bends.uv_map = LAYER
                tree.links.new(target.outputs["Color"], bends.inputs["Color"])
                tree.links.new(bends.outputs["Normal"], entry)
            else:
                tree.links.new(target.outputs["Color"], entry)
    finally:
        tree.links.new(surface, output.inputs["Surface"])
        tree.nodes.remove(shining)
        for other, node in others:
            other.node_tree.nodes.remove(node)


def _add_disjoint_uvs(bpy: Any, owners: list[Any]) -> None:
    """Adds to the objects' meshes a UV set in which no faces overlap, not even those of different meshes."""
    fresh = [thing for thing in owners if LAYER not in thing.data.uv_layers]
    if not fresh:
        return
    rendered = {}
    for thing in owners:
        layers = thing.data.uv_layers
        rendered[thing.name] = next((each.name for each in layers if each.active_render), None)
        layer = layers.get(LAYER) or layers.new(name=LAYER, do_init=False)
        layers.active = layer
    _select(bpy, owners)
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        bpy.ops.mesh.reveal(select=False)
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.uv.smart_project(angle_limit=1.15, island_margin=0.005, scale_to_bounds=False)
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
    for thing in owners:
        name = rendered[thing.name]
        if name is not None:
            thing.data.uv_layers[name].active_render = True


def _select(bpy: Any, owners: list[Any]) -> None:
    for thing in bpy.context.view_layer.objects:
        thing.select_set(False)
    for thing in owners:
        thing.hide_set(False)
        thing.hide_viewport = thing.hide_select = thing.hide_render = False
        thing.select_set(True)
        thing.data.uv_layers.active = thing.data.uv_layers.get(LAYER) or thing.data.uv_layers.active
    bpy.context.view_layer.objects.active = owners[0]


def _assign_dummy_images(bpy: Any, material: Any, owners: list[Any]) -> list[tuple[Any, Any]]:
    """Adds an active node with a dummy image to each other material of the objects that use `material`.

    Blender bakes all materials of a mesh at once, and fails if one of them has no image to write to. owners: the objects that
    use `material`. Returns the added nodes as (material, node), so that the caller can remove them.
    """
    found = []
    names = {material.name}
    for thing in owners:
        for slot in thing.material_slots:
            other = slot.material
            if other is None or other.name in names or not other.use_nodes:
                continue
            names.add(other.name)
            node = other.node_tree.nodes.new("ShaderNodeTexImage")
            node.image = bpy.data.images.new("rayfarm unused", 8, 8)
            other.node_tree.nodes.active = node
            found.append((other, node))
    return found


def _limit_to_one(image: Any, entry: Any) -> str:
    """Limits a baked linear image to 0 ... 1 and encodes it as sRGB; returns a note on clipped values, or "".

    entry: the material input for which the image was baked. Emission images are not clipped but scaled down, and the emission
    strength is multiplied by the divisor.
    """
    import numpy as np

    texels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(texels)
    colors = texels.reshape(-1, image.channels)
    most, told = float(colors[:, :3].max(initial=0.0)), ""
    if most > 1:
        power = entry.node.inputs["Emission Strength"]
        if entry.name == "Emission Color" and not power.is_linked:
            colors[:, :3] /= most
            power.default_value *= most
        else:
            told = Sentence("blend-input-clipped", "values of its input {input} above 1 are clipped", input=entry.name)
    linear = np.clip(colors[:, :3], 0.0, 1.0)
    colors[:, :3] = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    size = tuple(image.size)
    image.source = "GENERATED"
    image.use_generated_float = False
    image.generated_width, image.generated_height = size
    image.colorspace_settings.name = "sRGB"
    image.pixels.foreach_set(texels)
    return told


def _image(bpy: Any, material: Any, entry: Any, owners: list[Any]) -> Any:
    faces = sum(len(thing.data.polygons) for thing in owners)
    size = SIZE if faces > 6 else max(LEAST_SIZE, SIZE // 2)
    is_lit = entry.name in LIT
    image = bpy.data.images.new(f"{material.name} {entry.name.lower()}"[:60], size, size, alpha=False, float_buffer=is_lit)
    image.colorspace_settings.name = "Linear Rec.709" if is_lit else "sRGB" if entry.type == "RGBA" else "Non-Color"
    return image
