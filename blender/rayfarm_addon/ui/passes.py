"""Converts the farm's AOVs to Blender's render passes, in Blender's axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..scene.ids import Ids
from ..scene.view import Shot

__all__ = ["PASSES", "Pass", "enabled_passes", "planes_of", "values"]

F32 = npt.NDArray[np.float32]
MISS_DEPTH = 1e10  # Cycles' depth where no object is hit


class Pass(NamedTuple):
    """A render pass of Blender, and the farm's AOV from which it is computed.

    name, ids, kind: as registered in Blender. plane: the farm's AOV; channels: of the AOV in the EXR file. option: the property
    of the view layer that enables the pass.
    """

    name: str
    ids: str
    kind: str
    plane: str
    channels: tuple[str, ...]
    option: str


COMBINED = Pass("Combined", "RGBA", "COLOR", "", ("R", "G", "B"), "")
PASSES = (
    Pass("Depth", "Z", "VALUE", "depth", ("Depth.Z",), "use_pass_z"),
    Pass("Position", "XYZ", "VECTOR", "position", ("Position.X", "Position.Y", "Position.Z"), "use_pass_position"),
    Pass("Normal", "XYZ", "VECTOR", "normal", ("Normal.X", "Normal.Y", "Normal.Z"), "use_pass_normal"),
    Pass("IndexOB", "X", "VALUE", "object", ("IndexOB.X",), "use_pass_object_index"),
    Pass("IndexMA", "X", "VALUE", "material", ("IndexMA.X",), "use_pass_material_index"),
    Pass(
        "Denoising Albedo",
        "RGB",
        "COLOR",
        "albedo",
        ("Denoising Albedo.R", "Denoising Albedo.G", "Denoising Albedo.B"),
        "albedo",
    ),
)


def enabled_passes(scene: Any, layer: Any) -> list[Pass]:
    """Returns the passes that are enabled in a view layer, except Combined."""
    return [each for each in PASSES if (scene.rayfarm.albedo if each.option == "albedo" else getattr(layer, each.option, False))]


def planes_of(passes: list[Pass]) -> tuple[str, ...]:
    """Returns the AOVs to request for these passes. The material AOV needs the object AOV, which distinguishes some materials."""
    planes = [each.plane for each in passes]
    return tuple(dict.fromkeys(planes + (["object"] if "material" in planes else [])))


def values(each: Pass, channels: Mapping[str, F32], shot: Shot, ids: Ids) -> F32:
    """Returns the values of a render pass as Blender expects them: (h * w, channels), rows from the bottom.

    channels: the farm's image by EXR channel names. shot: the view and the needed part. ids: tables of pass indices.
    """
    if each.plane == "depth":
        found = _depth(channels, shot)
    else:
        found = np.stack([channels[name] for name in each.channels], axis=-1)
        if each.plane in ("position", "normal"):
            found = np.stack([found[..., 0], -found[..., 2], found[..., 1]], axis=-1)
        elif each.plane in ("object", "material"):
            numbers = {name: channels[name].astype(np.int64) for name in ("IndexOB.X", *each.channels)}
            objects = numbers["IndexOB.X"]
            found = ids.object(objects) if each.plane == "object" else ids.material(numbers["IndexMA.X"], objects)
            found = found[..., None]
    cut = shot.crop(found)[::-1]
    if each.name == "Combined":
        alpha = shot.crop(channels["A"])[::-1] if "A" in channels else np.ones(cut.shape[:2], np.float32)
        cut = np.concatenate([cut, alpha[..., None]], axis=-1)
    return np.ascontiguousarray(cut, np.float32).reshape(-1, cut.shape[-1])


def _depth(channels: Mapping[str, F32], shot: Shot) -> F32:
    """Returns the depth along the camera's axis, as in Cycles, computed from the farm's distance along the ray."""
    depth = channels["Depth.Z"]
    share = np.ones_like(depth)
    if "projection" not in shot.view:
        height, width = depth.shape
        slope = math.tan(math.radians(shot.view["fov"]) / 2)
        right, up = (shot.view.get(name, 0.0) for name in ("shift_x", "shift_y"))
        y = (2 * (np.arange(height) + 0.5) / height - 1 - 2 * up) * slope
        x = ((2 * (np.arange(width) + 0.5) - width) / height + 2 * right) * slope
        share = 1 / np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    return np.where(depth > 0, depth * share, MISS_DEPTH).astype(np.float32)[..., None]
