"""Bakes unsupported worlds with Cycles in a separate Blender process, since Blender cannot do so while it renders."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import bpy

from ..scene import skies

__all__ = ["baked_panorama"]

WIDTH, MOST_WIDTH = 2048, 8192
PATIENCE_S = 120.0
MAX_CACHED_WORLDS = 4  # number of cached worlds

_known: dict[str, tuple[bytes, Any]] = {}


def baked_panorama(world: Any) -> tuple[bytes, dict[str, Any] | None] | None:
    """Returns a world's panorama as an EXR file and the sun omitted from it (see `skies.photographed`); None if baking fails."""
    key = _digest(world.node_tree)
    if key not in _known:
        made = _run_baking(world)
        if made is None:
            return None
        _known[key] = made
        while len(_known) > MAX_CACHED_WORLDS:
            del _known[next(iter(_known))]
    return _known[key]


def _run_baking(world: Any) -> tuple[bytes, Any] | None:
    with tempfile.TemporaryDirectory(prefix="rayfarm-world-") as name:
        folder = Path(name)
        bpy.data.libraries.write(str(folder / "world.blend"), {world.original}, path_remap="ABSOLUTE", fake_user=True)
        images = [
            node.image.size[0] for node in world.node_tree.nodes if node.type == "TEX_ENVIRONMENT" and node.image is not None
        ]
        width = str(max(min(max(images, default=WIDTH), MOST_WIDTH), 64))
        command = [*_blender(), str(Path(skies.__file__))]
        command += ["--"] if bpy.app.binary_path else []
        try:
            arguments = [str(folder / "world.blend"), name, width]
            subprocess.run([*command, *arguments], capture_output=True, timeout=PATIENCE_S, check=True)
            return (folder / skies.PICTURE).read_bytes(), json.loads((folder / skies.TOLD).read_text())
        except (OSError, subprocess.SubprocessError, ValueError):
            return None


def _blender() -> list[str]:
    if not bpy.app.binary_path:
        return [sys.executable, "-I"]
    return [bpy.app.binary_path, "--background", "--factory-startup", "--disable-autoexec", "--python"]


def _digest(tree: Any) -> str:
    """Returns a digest of a node tree that changes whenever the nodes, their values or their links do."""
    said: list[Any] = []
    for node in tree.nodes:
        said.append((node.bl_idname, node.name, node.mute))
        said += [(each.name, _plain_value(getattr(each, "default_value", None))) for each in node.inputs]
        said += [(p.identifier, _plain_value(getattr(node, p.identifier))) for p in node.bl_rna.properties if not p.is_readonly]
        if node.type == "VALTORGB":
            said += [(each.position, tuple(each.color)) for each in node.color_ramp.elements]
        if node.type == "GROUP" and node.node_tree is not None:
            said.append(_digest(node.node_tree))
    said += [
        (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier) for link in tree.links
    ]
    return hashlib.sha256(repr(said).encode()).hexdigest()


def _plain_value(value: Any) -> Any:
    if isinstance(value, int | float | str) or value is None:
        return value
    if isinstance(value, bpy.types.Image):
        return value.name_full, value.filepath, tuple(value.size), value.is_dirty
    if isinstance(value, bpy.types.ID):
        return value.name_full
    try:
        return tuple(value)
    except TypeError:
        return ""
