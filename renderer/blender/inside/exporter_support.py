"""Determines which shader nodes, between a socket and UV-mapped images, Blender's glTF exporter supports."""

from __future__ import annotations

from typing import Any

__all__ = ["differs_by_object", "is_placed_by_uv", "is_supported", "view_dependent_label"]

ENDS = {"ATTRIBUTE", "VERTEX_COLOR", "VALUE", "RGB"}
PASSED = {"REROUTE", "SEPARATE_COLOR", "SEPRGB"}
TOLERANCE = 1e-6
# Nodes that depend on the view, and so cannot be baked to an image.
FROM_ELSEWHERE = {"FRESNEL", "LAYER_WEIGHT", "LIGHT_PATH"}
OUTPUTS_FROM_ELSEWHERE = {"Reflection", "Incoming"}
OUTPUTS_OF_EACH = {"Position", "Camera", "Window", *OUTPUTS_FROM_ELSEWHERE}


def is_supported(node: Any) -> bool:
    """Returns True if the glTF exporter supports a shader node and all nodes connected to its inputs."""
    seen, left = set(), [node]
    while left:
        each = left.pop()
        if each.name in seen:
            continue
        seen.add(each.name)
        if each.type == "TEX_IMAGE":
            if each.image is None or each.projection != "FLAT" or not is_placed_by_uv(each):
                return False
            continue
        if each.type == "NORMAL_MAP":
            if each.space != "TANGENT" or each.inputs["Strength"].is_linked:
                return False
        elif each.type not in ENDS | PASSED and not _is_factor(each):
            return False
        left += [link.from_node for entry in each.inputs for link in entry.links]
    return True


def _is_factor(node: Any) -> bool:
    """Returns True if a shader node only multiplies its inputs."""
    if node.type == "MATH":
        return node.operation == "MULTIPLY" and not node.use_clamp
    if node.type not in ("MIX", "MIX_RGB") or node.blend_type != "MULTIPLY" or getattr(node, "data_type", "RGBA") != "RGBA":
        return False
    share = node.inputs[0]
    return not share.is_linked and abs(share.default_value - 1) < TOLERANCE


def is_placed_by_uv(node: Any) -> bool:
    """Returns True if an image node is mapped by a UV set, with at most one rotation, scale and translation in the UV plane."""
    entry, is_mapped = node.inputs["Vector"], False
    while entry.is_linked:
        link = entry.links[0]
        each = link.from_node
        if each.type == "REROUTE":
            entry = each.inputs[0]
        elif each.type == "MAPPING" and not is_mapped and _is_flat(each):
            entry, is_mapped = each.inputs["Vector"], True
        else:
            return each.type in ("UVMAP", "ATTRIBUTE") or (each.type == "TEX_COORD" and link.from_socket.name == "UV")
    return not is_mapped


def _is_flat(mapping: Any) -> bool:
    if mapping.vector_type not in ("POINT", "VECTOR"):
        return False
    if any(entry.is_linked for entry in mapping.inputs if entry.name != "Vector"):
        return False
    turn = mapping.inputs["Rotation"].default_value
    return abs(turn[0]) < TOLERANCE and abs(turn[1]) < TOLERANCE


def view_dependent_label(node: Any, output: str) -> str:
    """Returns the label of a view-dependent node on which an output depends; empty if there is none."""
    return next(
        (
            str(each.bl_label)
            for each, name in _feeding_nodes(node, output)
            if each.type in FROM_ELSEWHERE or name in OUTPUTS_FROM_ELSEWHERE
        ),
        "",
    )


def differs_by_object(node: Any, output: str) -> bool:
    """Returns True if a node's output depends on the object, so that objects which share a mesh have different values."""
    return any(each.type == "OBJECT_INFO" or name in OUTPUTS_OF_EACH for each, name in _feeding_nodes(node, output))


def _feeding_nodes(node: Any, output: str) -> list[tuple[Any, str]]:
    """Returns a node and all nodes on which its output depends, each with the name of the output that is used."""
    found: list[tuple[Any, str]] = []
    left = [(node, output)]
    while left:
        each = left.pop()
        if each not in found:
            found.append(each)
            left += [(link.from_node, link.from_socket.name) for entry in each[0].inputs for link in entry.links]
    return found
