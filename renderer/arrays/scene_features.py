"""The features of a scene that determine its kernel variant: code for absent features is not compiled."""

from __future__ import annotations

from typing import Any, NamedTuple

__all__ = ["EVERYTHING", "KERNEL_VARIANTS", "SceneFeatures"]


class SceneFeatures(NamedTuple):
    """The features that a scene may have; each field is True if the scene has the feature, else None.

    Numba types None separately, so code under `if scene.has.textures is not None` is pruned from a kernel whose scenes have no
    textures (renderer/prune_absent_features.py), which saves compile time and registers.
    """

    textures: Any  # and normal maps, vertex colours, alpha, and visibility by ray kind
    lights: Any  # punctual lights, or enough lights for a light tree
    layers: Any  # materials of many properties, absorption, and dispersion
    instances: Any
    motion: Any  # while the shutter is open: of the camera, or of anything else
    media: Any  # scattering media, or media without a surface; and subsurface scattering
    targets: Any  # bodies at which paths aim (renderer/kernel/steps/aim.py)
    pivots: Any  # small lamps in scattering media (renderer/kernel/medium/equiangular.py)
    grids: Any  # heterogeneous media (renderer/kernel/medium/volume.py)
    links: Any  # lights that illuminate some objects only (renderer/kernel/light/links.py)
    hair: Any  # the hair BSDF, and curves and tubes that are its fibres
    groups: Any  # planes by light group, which settings request (RenderSettings.light_groups); in no variant by itself
    light_paths: Any = None  # planes by light path, likewise (RenderSettings.light_paths)
    by_light: Any = None  # either
    visibility: Any = None  # of objects and lights by kind of ray, and shadow links (renderer/kernel/steps/ray_kind.py)
    reflections: Any = None  # on reflection catchers (renderer/kernel/steps/catch_reflections.py)
    huang: Any = None  # the second hair BSDF (renderer/kernel/bsdf/huang.py)


# From the fastest to compile and run to the most complete. All combinations would be 4,096 variants, each compiled at its first
# use, while a render waits.
KERNEL_VARIANTS = {
    "plain": SceneFeatures(None, None, None, None, None, None, None, None, None, None, None, None),
    "full": SceneFeatures(True, True, True, True, None, None, None, None, None, None, None, None),
    "moving": SceneFeatures(True, True, True, True, True, None, None, None, None, None, None, None),
    "media": SceneFeatures(True, True, True, True, None, True, None, None, None, None, None, None),
    "moving-media": SceneFeatures(True, True, True, True, True, True, None, None, None, None, None, None),
    "lit-media": SceneFeatures(True, True, True, True, None, True, None, True, None, None, None, None),
    "aimed": SceneFeatures(True, True, True, True, None, None, True, None, None, None, None, None),
    "complete": SceneFeatures(True, True, True, True, True, True, True, True, None, None, None, None),
    "grids": SceneFeatures(True, True, True, True, True, True, True, True, True, None, None, None),
    "linked": SceneFeatures(True, True, True, True, True, True, True, True, True, True, None, None),
    "hair": SceneFeatures(True, True, True, True, None, None, None, None, None, None, True, None),
    "moving-hair": SceneFeatures(True, True, True, True, True, True, True, True, True, True, True, None),
    "visibility": SceneFeatures(True, True, True, True, True, True, True, True, True, True, True, None, visibility=True),
    "catchers": SceneFeatures(True, True, True, True, None, None, None, None, None, None, None, None, reflections=True),
    "moving-catchers": SceneFeatures(
        True, True, True, True, True, True, True, True, True, True, True, None, visibility=True, reflections=True
    ),
    "huang": SceneFeatures(True, True, True, True, None, None, None, None, None, None, True, None, huang=True),
    "moving-huang": SceneFeatures(
        True, True, True, True, True, True, True, True, True, True, True, None, visibility=True, reflections=True, huang=True
    ),
}
EVERYTHING = KERNEL_VARIANTS["full"]  # of static scenes
