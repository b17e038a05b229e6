"""Adds notes on material features that glTF cannot represent."""

from __future__ import annotations

from typing import Any

from .keys import animated_paths

__all__ = ["note_surfaces"]

# Nodes that Blender's exporter supports between a texture and a Principled BSDF.
FOLLOWED = {
    *("TEX_IMAGE", "MAPPING", "UVMAP", "TEX_COORD", "NORMAL_MAP", "SEPARATE_COLOR", "SEPRGB", "COMBINE_COLOR", "REROUTE", "RGB"),
    *(
        "VALUE",
        "MIX",
        "MIX_RGB",
        "MATH",
        "ATTRIBUTE",
        "VERTEX_COLOR",
        "GROUP",
        "GROUP_INPUT",
        "GROUP_OUTPUT",
        "VECT_MATH",
        "INVERT",
    ),
}
SURFACES = {"BSDF_PRINCIPLED", "EMISSION", "BACKGROUND"}
UNKNOWN = {
    "Diffuse Roughness": "rough diffuse (Oren-Nayar)",
}
UNKNOWN_ALONE = {"Subsurface Weight": "subsurface scattering"}
MOST_NODES = 10_000


def note_surfaces(materials: list[Any], notes: list[str], is_read: bool) -> None:
    """Adds notes on features of materials that are ignored.

    is_read: whether the add-on's modules export volumes.
    """
    for material in materials:
        tree = material.node_tree if material.use_nodes else None
        output = _output(tree) if tree is not None else None
        if output is None:
            continue
        name = f"Material {material.name}"
        if animated_paths(tree):
            notes.append(f"{name}: its nodes move with the frame in Blender, and are as at the first frame here")
        if output.inputs["Displacement"].links and not is_read:
            notes.append(f"{name}: its displacement is not taken over; apply it as a modifier, or bake a normal map")
        if output.inputs["Volume"].links and not is_read:
            notes.append(f"{name}: its volume is not taken over")
        if not output.inputs["Surface"].links:
            continue
        surface = output.inputs["Surface"].links[0].from_node
        if surface.type not in SURFACES:
            notes.append(
                f"{name}: its surface is a {_node_label(surface)}, of which glTF has the nearest that it knows: "
                "use a Principled BSDF"
            )
        if surface.type == "BSDF_PRINCIPLED":
            unknown = UNKNOWN if is_read else UNKNOWN | UNKNOWN_ALONE
            lost = [words for entry, words in unknown.items() if _is_used(surface.inputs.get(entry))]
            if lost:
                notes.append(f"{name}: {' and '.join(lost)} {'is' if len(lost) == 1 else 'are'} not taken over")
        odd = sorted({_node_label(node) for node in _upstream_nodes(surface) if node.type not in FOLLOWED | SURFACES})
        if odd and surface.type in SURFACES:
            notes.append(f"{name}: what {', '.join(odd[:6])} would make of it is not taken over; bake it to an image")


def _is_used(entry: Any) -> bool:
    return entry is not None and (bool(entry.links) or float(entry.default_value) > 0)


def _output(tree: Any) -> Any:
    outputs = [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL" and node.is_active_output]
    return next((node for node in outputs if node.target in ("ALL", "CYCLES")), outputs[0] if outputs else None)


def _node_label(node: Any) -> str:
    return str(node.bl_label or node.type)


def _upstream_nodes(node: Any) -> list[Any]:
    """Returns all nodes on which a node depends."""
    found: dict[str, Any] = {}
    left = [link.from_node for entry in node.inputs for link in entry.links]
    while left and len(found) < MOST_NODES:
        each = left.pop()
        if each.name not in found:
            found[each.name] = each
            left += [link.from_node for entry in each.inputs for link in entry.links]
    return list(found.values())
