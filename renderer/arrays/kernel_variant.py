"""Selects the kernel variant that renders a scene. It depends on the scene only, so one variant renders all its samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import SEEN_BY_ALL
from renderer.arrays.scene import CompiledScene
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.bvh.layout import RAY_KINDS

__all__ = ["moving_variant", "strip_absent_features", "variant_of"]

_TEXTURES = rows.TEXTURED | rows.NORMAL_MAPPED | rows.NEEDS_TANGENT | rows.TRANSPARENT
_HIDDEN = rows.LAMP | rows.UNSEEN | rows.SHADELESS | rows.FACING
_LAYERS = rows.DISPERSIVE | rows.ABSORBING | rows.BECKMANN
_NOTHING: Any = None  # replaces an array of a feature that the variant lacks
_LINKS = ("light_link", "object_links")
_MEDIA = ("medium", "material_medium")
_GRIDS = ("volume", "volume_grid", "voxel", "majorant")
_KEYS = ("key_position", "key_normal", "key_sphere", "key_punctual", "key_emission_frame", "key_texture")
_PART_OF = {kind.number: kind.part for kind in rows.KINDS}


def variant_of(scene: CompiledScene, camera_moves: bool = False) -> str:
    """Returns the name of the first of KERNEL_VARIANTS that supports all features of the scene.

    camera_moves: whether the camera moves while the shutter is open, or its lens distorts. Raises ValueError if a material's kind
    is not in `rows.KINDS`.
    """
    flags = int(np.bitwise_or.reduce(scene.material_flags))
    parts = _parts_of_kinds(scene)
    needs = {
        "textures": bool(flags & (_TEXTURES | _HIDDEN)) or len(scene.color) > 0,
        "lights": len(scene.light_node) > 0 or len(scene.punctual) > 0,
        "layers": bool(flags & _LAYERS) or "layers" in parts,
        "instances": len(scene.to_world) > 0,
        "motion": camera_moves or _moves(scene),
        "media": "media" in parts or bool(flags & rows.SCATTERS_WITHIN) or len(scene.medium) > 1 or bool(scene.medium.any()),
        "targets": len(scene.target) > 0,
        "links": len(scene.object_links) > 0,
        "pivots": len(scene.pivot) > 0,
        "grids": len(scene.volume) > 0,
        "hair": "hair" in parts or "huang" in parts or bool(flags & rows.FLAT_CURVES),
        "huang": "huang" in parts,
        "visibility": len(scene.bvh.ray_roots) > 2,
        "reflections": bool(flags & rows.REFLECTIONS),
    }
    wanted = {part for part, needed in needs.items() if needed}
    return next(name for name, has in KERNEL_VARIANTS.items() if all(getattr(has, part) for part in wanted))


def moving_variant(scene: CompiledScene) -> str:
    """Returns the variant for kernels that only need what rays hit, at any time: with curves if the scene may have some."""
    if rows.HUANG in scene.material_kind:
        return "moving-huang"
    has_curves = rows.HAIR in scene.material_kind or bool((scene.material_flags & rows.FLAT_CURVES).any())
    return "moving-hair" if has_curves else "moving"


def strip_absent_features(scene: CompiledScene, variant: str, groups: bool = False, paths: bool = False) -> CompiledScene:
    """Returns the scene as the variant's kernels expect it: with None for every array of a feature that the variant lacks.

    groups: whether the kernel sums the light of each light group separately; the array `group_plane` is then kept. paths:
    whether it sums the light of each light path separately.
    """
    requested = {"groups": groups, "light_paths": paths, "by_light": groups or paths}
    has = KERNEL_VARIANTS[variant]._replace(**{name: True if wanted else None for name, wanted in requested.items()})
    bvh = scene.bvh._replace(instances=has.instances, curves=has.hair)
    if has.textures is None:
        bvh = bvh._replace(ray_roots=_NOTHING)
    if has.targets is None:
        scene = scene._replace(target=_NOTHING)
    if has.links is None:
        scene = scene._replace(**dict.fromkeys(_LINKS, _NOTHING))
    elif len(scene.light_link) == 0:  # a kernel looks up light 0 and object 0 where there is none
        objects = scene.object_links if len(scene.object_links) else _filled(1, 1)
        scene = scene._replace(light_link=_filled(max(len(scene.light_primitive), 1), 0), object_links=objects)
    if has.visibility is None:
        scene = scene._replace(light_visibility=_NOTHING)
    else:  # likewise
        if len(bvh.ray_roots) < len(RAY_KINDS):
            bvh = bvh._replace(ray_roots=_read_only(np.append(bvh.ray_roots, np.zeros(len(RAY_KINDS) - 2, np.int32))))
        if len(scene.light_visibility) == 0:
            scene = scene._replace(light_visibility=_filled(max(len(scene.light_primitive), 1), SEEN_BY_ALL))
    if has.grids is None:
        scene = scene._replace(**dict.fromkeys(_GRIDS, _NOTHING))
    if has.pivots is None:
        scene = scene._replace(pivot=_NOTHING)
    if has.media is None:
        scene = scene._replace(**dict.fromkeys(_MEDIA, _NOTHING))
    if has.motion is None:
        scene = scene._replace(**dict.fromkeys(_KEYS, _NOTHING))
        bvh = bvh._replace(**dict.fromkeys(("motion", "instance_motion", "keyed_packets"), _NOTHING))
    return scene._replace(has=has, bvh=bvh)


def _filled(count: int, value: int) -> np.ndarray:
    """Returns a read-only array of equal numbers, (count,) i32."""
    return _read_only(np.full(count, value, np.int32))


def _read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


def _parts_of_kinds(scene: CompiledScene) -> set[str]:
    """Returns the names of the kernel features (fields of `SceneFeatures`) that the scene's materials require."""
    kinds = np.unique(scene.material_kind).tolist()
    if unknown := [kind for kind in kinds if kind not in _PART_OF]:
        raise ValueError(f"material kinds {unknown} are not declared; add them to KINDS in renderer/arrays/rows.py")
    return {_PART_OF[kind] for kind in kinds}


def _moves(scene: CompiledScene) -> bool:
    moving = scene.bvh.instance_motion, scene.key_position, scene.key_sphere, scene.key_punctual, scene.key_texture
    return any(len(array) > 0 for array in moving)
