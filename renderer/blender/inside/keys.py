"""Values sampled over the frames, in the notation of Rayfarm's scene format."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

__all__ = [
    "MOST_FRAMES",
    "animated_paths",
    "frames_of",
    "is_animated",
    "keyed",
    "over_frames",
    "rounded",
    "scripted",
    "shutter_frames",
]

MOST_FRAMES = 10_000
TOLERANCE = 1e-9


def rounded(value: Any) -> Any:
    """Rounds a number, or all numbers in a list or dict, to eight digits, the precision of Blender's float32."""
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, str | int) or value is None:
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            return 0.0
        short = float(f"{value:.8g}")
        return short if abs(short) > 1e-12 else 0.0
    return [rounded(each) for each in value]


MAY_MOVE = (
    *("objects", "meshes", "curves", "lights", "cameras", "armatures", "materials", "worlds", "node_groups", "shape_keys"),
    "lattices",
)


def scripted(bpy: Any) -> list[str]:
    """Returns the names of data blocks with drivers written in Python, which do not run with scripts off."""
    found = set()
    for kind in MAY_MOVE:
        for block in getattr(bpy.data, kind, ()):
            for owner in (block, getattr(block, "node_tree", None)):
                data = owner.animation_data if owner is not None else None
                drivers = [curve.driver for curve in data.drivers] if data is not None else []
                if any(each.type == "SCRIPTED" and not each.is_simple_expression for each in drivers):
                    found.add(block.name)
    return sorted(found)


def is_animated(bpy: Any, scene: Any) -> bool:
    """Returns True if anything in the file may change from frame to frame."""
    for kind in MAY_MOVE:
        for block in getattr(bpy.data, kind, ()):
            data = block.animation_data
            if data is not None and (data.action or data.drivers or any(track.strips for track in data.nla_tracks)):
                return True
            tree = getattr(block, "node_tree", None)
            if tree is not None and (data := tree.animation_data) is not None and (data.action or data.drivers):
                return True
    if any(thing.rigid_body is not None or thing.particle_systems for thing in scene.objects):
        return True
    moving = (
        "CLOTH",
        "SOFT_BODY",
        "WAVE",
        "OCEAN",
        "MESH_CACHE",
        "MESH_SEQUENCE_CACHE",
        "DYNAMIC_PAINT",
        "FLUID",
        "NODES",
        "BUILD",
    )
    if any(modifier.type in moving for thing in scene.objects for modifier in thing.modifiers):
        return True
    return any(
        constraint.type in ("FOLLOW_PATH", "TRANSFORM_CACHE") for thing in scene.objects for constraint in thing.constraints
    )


def animated_paths(block: Any) -> list[str]:
    """Returns the paths of a data block's properties that are animated by keyframes or drivers."""
    data = block.animation_data if block is not None else None
    if data is None:
        return []
    curves = [*data.drivers]
    if data.action is not None:
        own = getattr(data.action, "fcurves", None)  # until Blender 5
        if own is None:
            strips = [strip for layer in data.action.layers for strip in layer.strips]
            own = [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]
        curves += own
    return [curve.data_path for curve in curves]


def frames_of(bpy: Any, scene: Any) -> list[int]:
    """Returns the frame numbers of the scene's range; for a static scene only the current one."""
    if not is_animated(bpy, scene):
        return [scene.frame_current]
    return list(range(scene.frame_start, min(scene.frame_end, scene.frame_start + MOST_FRAMES - 1) + 1)) or [scene.frame_current]


def shutter_frames(frames: list[int], settings: dict[str, Any]) -> list[int]:
    """Returns the frame numbers, extended by those that the open shutter overlaps; none below 0, the start of time.

    Never exactly two frames: for two keys Blender's exporter writes step interpolation. settings: the render settings.
    """
    length = settings.get("shutter", 0.0)
    before = {"leading": 0.0, "trailing": 1.0}.get(settings.get("shutter_at", ""), 0.5) * length
    first = min(frames[0], max(frames[0] - math.ceil(before), 0))
    last = frames[-1] + math.ceil(length - before)
    return list(range(first, last + (2 if last == first + 1 else 1)))


def over_frames(scene: Any, frames: Iterable[int], state_functions: dict[str, Callable[[], Any]]) -> dict[str, list[Any]]:
    """Evaluates functions at each of the frames; returns a dict of function name -> results in the order of the frames."""
    found: dict[str, list[Any]] = {name: [] for name in state_functions}
    for frame in frames:
        scene.frame_set(frame)
        for name, look in state_functions.items():
            found[name].append(look())
    return found


def keyed(values: list[Any], frames: list[int], fps: float) -> Any:
    """Returns a value sampled at the frames in scene file notation: the value if it is constant, else as keys.

    Keys: {"keys": [[frame / fps, value], ...]}, without those between two equal ones.
    """
    values = [rounded(value) for value in values]
    if all(_are_nearly_equal(value, values[0]) for value in values):
        return values[0]
    keys = []
    for i, value in enumerate(values):
        is_between = (
            0 < i < len(values) - 1 and _are_nearly_equal(value, values[i - 1]) and _are_nearly_equal(value, values[i + 1])
        )
        if not is_between:
            keys.append([frames[i] / fps, value])
    return {"keys": keys}


def _are_nearly_equal(a: Any, b: Any) -> bool:
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(_are_nearly_equal(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return abs(a - b) <= TOLERANCE * max(1.0, abs(a), abs(b))
    return bool(a == b)
