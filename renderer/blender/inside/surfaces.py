"""Adds notes on material features that glTF cannot represent."""

from __future__ import annotations

from typing import Any

from .keys import animated_paths
from .sentences import Sentence

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
    "Diffuse Roughness": Sentence("blend-diffuse-roughness", "diffuse roughness (Oren-Nayar)"),
}
UNKNOWN_ALONE = {"Subsurface Weight": Sentence("blend-subsurface", "subsurface scattering")}
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
        if animated_paths(tree):
            notes.append(
                Sentence(
                    "blend-material-animated-nodes",
                    "Material {material}: its animated nodes are evaluated at the first frame",
                    material=material.name,
                )
            )
        if output.inputs["Displacement"].links and not is_read:
            notes.append(
                Sentence(
                    "blend-displacement-left-out",
                    "Material {material}: its displacement is left out; apply it as a modifier, or bake a normal map",
                    material=material.name,
                )
            )
        if output.inputs["Volume"].links and not is_read:
            notes.append(
                Sentence("blend-material-volume-left-out", "Material {material}: its volume is left out", material=material.name)
            )
        if not output.inputs["Surface"].links:
            continue
        surface = output.inputs["Surface"].links[0].from_node
        if surface.type not in SURFACES:
            notes.append(
                Sentence(
                    "blend-shader-approximated",
                    "Material {material}: glTF approximates its shader {shader}; use a Principled BSDF",
                    material=material.name,
                    shader=_node_label(surface),
                )
            )
        if surface.type == "BSDF_PRINCIPLED":
            unknown = UNKNOWN if is_read else UNKNOWN | UNKNOWN_ALONE
            lost = [words for entry, words in unknown.items() if _is_used(surface.inputs.get(entry))]
            if lost:
                notes.append(
                    Sentence(
                        "blend-features-left-out",
                        "Material {material}: left out: {features}",
                        material=material.name,
                        features=lost,
                    )
                )
        odd = sorted({_node_label(node) for node in _upstream_nodes(surface) if node.type not in FOLLOWED | SURFACES})
        if odd and surface.type in SURFACES:
            notes.append(
                Sentence(
                    "blend-nodes-left-out",
                    "Material {material}: its nodes {nodes} are left out; bake them to an image",
                    material=material.name,
                    nodes=odd[:6],
                )
            )


def _is_used(entry: Any) -> bool:
    return entry is not None and (bool(entry.links) or float(entry.default_value) > 0)


def _output(tree: Any) -> Any:
    outputs = [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL" and node.is_active_output]
    return next((node for node in outputs if node.target in ("ALL", "CYCLES")), outputs[0] if outputs else None)


def _node_label(node: Any) -> str:
    return str(node.bl_label or node.type)


def _upstream_nodes(node: Any) -> list[Any]:
    """Returns all nodes on which a shader node depends."""
    found: dict[str, Any] = {}
    left = [link.from_node for entry in node.inputs for link in entry.links]
    while left and len(found) < MOST_NODES:
        each = left.pop()
        if each.name not in found:
            found[each.name] = each
            left += [link.from_node for entry in each.inputs for link in entry.links]
    return list(found.values())
