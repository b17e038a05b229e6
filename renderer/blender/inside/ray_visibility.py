"""Adds to a GLB file what the glTF exporter does not write: ray visibility of objects, and properties of materials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .glb import Glb
from .sentences import Sentence

__all__ = ["KINDS", "RAYS", "matte_flags_of", "note_rays", "ray_flags_of", "write_extensions"]

RAYS = "RAYFARM_node_rays"  # read by renderer/scene/readers/gltf/nodes.py
# The kinds of rays, and Blender's flags for whether they hit an object.
KINDS = {
    "camera": "visible_camera",
    "shadow": "visible_shadow",
    "diffuse": "visible_diffuse",
    "glossy": "visible_glossy",
    "transmission": "visible_transmission",
    "volume": "visible_volume_scatter",
}
FACTORS = ("baseColorFactor", "roughnessFactor")
DISPLACEMENT = "RAYFARM_materials_displacement"  # read by renderer/scene/material.py

Flags = dict[str, bool]


def ray_flags_of(objects: list[Any], layer: Any) -> dict[str, Flags]:
    """Returns object name -> kind of ray -> whether such rays hit it. Only objects that one kind ignores."""
    found = {}
    for thing in objects:
        is_indirect = layer is not None and thing.indirect_only_get(view_layer=layer)
        flags = {kind: bool(getattr(thing, flag, True)) for kind, flag in KINDS.items()}
        flags["camera"] &= not is_indirect
        if not all(flags.values()):
            found[thing.name] = flags
    return found


def matte_flags_of(thing: Any, layer: Any) -> Flags:
    """Returns the flags of an object that is a holdout or a shadow catcher; before a transparent film only.

    Cycles' shadow catchers show reflections and bounced light, too.
    """
    is_held = getattr(thing, "is_holdout", False) or (layer is not None and thing.holdout_get(view_layer=layer))
    catches = bool(getattr(thing, "is_shadow_catcher", False))
    flags = {"holdout": bool(is_held), "shadow_catcher": catches, "reflection_catcher": catches}
    return {name: True for name, is_set in flags.items() if is_set}


def note_rays(objects: list[Any], layer: Any, notes: list[str], is_transparent: bool) -> None:
    """Adds notes on holdouts and shadow catchers that are ignored. is_transparent: whether the film is."""
    for thing in objects:
        flags = {} if is_transparent else matte_flags_of(thing, layer)
        for name, what in (
            ("holdout", Sentence("blend-holdout", "a holdout")),
            ("shadow_catcher", Sentence("blend-shadow-catcher", "a shadow catcher")),
        ):
            if name in flags:
                notes.append(
                    Sentence(
                        "blend-special-object",
                        "{object}: rendered as an ordinary object, not as {kind}",
                        object=thing.name,
                        kind=what,
                    )
                )


def _set_factors(material: dict[str, Any], flags: dict[str, Any]) -> None:
    surface = material.setdefault("pbrMetallicRoughness", {})
    if "roughnessFactor" in flags:
        surface["roughnessFactor"] = flags["roughnessFactor"]
    if "baseColorFactor" in flags:
        *color, alpha = surface.get("baseColorFactor", [1.0] * 4)
        surface["baseColorFactor"] = [*(a * b for a, b in zip(color, flags["baseColorFactor"], strict=True)), alpha]


def write_extensions(
    path: Path, rays: dict[str, Flags], surfaces: dict[str, dict[str, Any]], named: dict[str, dict[str, str | bool]]
) -> None:
    """Writes into a GLB what the exporter leaves out, by name.

    rays: ray visibility of nodes. surfaces: extensions and factors of materials. named: light groups, link sets and
    matte flags of nodes, as extras.
    Among the factors, roughnessFactor replaces the exporter's value, and baseColorFactor multiplies it.
    """
    if not (rays or surfaces or named):
        return
    glb = Glb(path)
    document = glb.document
    used = set(document.get("extensionsUsed", []))
    for node in document.get("nodes", []):
        if node.get("name") in rays and "mesh" in node:
            node.setdefault("extensions", {})[RAYS] = rays[node["name"]]
            used.add(RAYS)
        if node.get("name") in named and "mesh" in node:
            node["extras"] = {**node.get("extras", {}), **named[node["name"]]}
    for material in document.get("materials", []):
        if (told := surfaces.get(material.get("name", ""))) is not None:
            extensions = {name: each for name, each in told.items() if name not in FACTORS}
            if DISPLACEMENT in extensions:
                extensions |= _displacement(glb, material, extensions.pop(DISPLACEMENT))
            material["extensions"] = {**material.get("extensions", {}), **extensions}
            used.update(extensions)
            _set_factors(material, told)
    document["extensionsUsed"] = sorted(used)
    glb.write(path)


def _displacement(glb: Glb, material: dict[str, Any], told: dict[str, Any]) -> dict[str, Any]:
    """Returns the extension with a material's displacement, with the mapping that the exporter wrote for its normal map.

    That normal map, a placeholder, is removed. told: as of `simplify`. Returns an empty dict if the exporter wrote none.
    """
    place = material.pop("normalTexture", None)
    if place is None:
        return {}
    texture = glb.texture(glb.image(told["png"]), place["index"])
    numbers = {name: value for name, value in told.items() if name != "png"}
    mapped = {name: value for name, value in place.items() if name != "scale"}
    return {DISPLACEMENT: {"displacementTexture": {**mapped, "index": texture}, **numbers}}
