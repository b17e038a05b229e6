"""File suffixes of values_kit.py, and how Blender writes them. Run by a Python that has bpy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

__all__ = ["CRASHES", "FILES"]


def _gltf(path: str, **more: Any) -> None:
    bpy.ops.export_scene.gltf(
        filepath=path, export_cameras=True, export_lights=True, export_animation_mode="SCENE", export_force_sampling=True,
        export_optimize_animation_size=False, export_anim_scene_split_object=False, export_all_influences=True, **more,
    )  # fmt: skip


def _fbx(path: str, **more: Any) -> None:
    wanted = {"add_leaf_bones": False, "bake_anim_use_nla_strips": False, "bake_anim_use_all_actions": False}
    bpy.ops.export_scene.fbx(filepath=path, bake_anim_simplify_factor=0.0, **wanted | more)


def _usd(path: str, **more: Any) -> None:
    bpy.ops.wm.usd_export(filepath=path, export_animation=True, export_armatures=True, export_shapekeys=True, **more)


def _obj(path: str, **more: Any) -> None:
    bpy.ops.wm.obj_export(filepath=path, **more)


def _ply(path: str, **more: Any) -> None:
    bpy.ops.wm.ply_export(filepath=path, **more)


def _stl(path: str, **more: Any) -> None:
    bpy.ops.wm.stl_export(filepath=path, **more)


def _dae(path: str, **more: Any) -> None:
    bpy.ops.wm.collada_export(filepath=path, **more)


LIKE_OBJ = {"forward_axis": "NEGATIVE_Z", "up_axis": "Y"}
BONES = {"primary_bone_axis": "X", "secondary_bone_axis": "Z"}
TO_Y = {"convert_orientation": True, "export_global_forward_selection": "NEGATIVE_Z", "export_global_up_selection": "Y"}
FILES: dict[str, tuple[str, Callable[..., None], dict[str, Any]]] = {
    "gltf": (".glb", _gltf, {}),
    "gltf-instanced": (".glb", _gltf, {"export_gpu_instances": True}),
    "gltf-separate": (".gltf", _gltf, {"export_format": "GLTF_SEPARATE"}),
    "fbx": (".fbx", _fbx, {}),
    "fbx-units": (".fbx", _fbx, {"apply_scale_options": "FBX_SCALE_UNITS"}),
    "fbx-all": (".fbx", _fbx, {"apply_scale_options": "FBX_SCALE_ALL", "add_leaf_bones": True}),
    "fbx-axes": (".fbx", _fbx, {"axis_forward": "X", "axis_up": "Z", **BONES}),
    "usd": (".usdc", _usd, {}),
    "usd-instanced": (".usda", _usd, {"use_instancing": True}),
    "usd-centimeters": (".usdc", _usd, {"convert_scene_units": "CENTIMETERS"}),
    "usd-turned": (".usdc", _usd, TO_Y),
    "obj": (".obj", _obj, {}),
    "obj-axes": (".obj", _obj, {"forward_axis": "Y", "up_axis": "Z"}),
    "obj-physical": (".obj", _obj, {"export_pbr_extensions": True}),
    "ply": (".ply", _ply, LIKE_OBJ),
    "stl": (".stl", _stl, LIKE_OBJ),
    "stl-text": (".stl", _stl, {"ascii_format": True}),
    "dae": (".dae", _dae, {}),
}
CRASHES = {("rig", "ply")}  # heap corruption in Blender 4.5 itself
