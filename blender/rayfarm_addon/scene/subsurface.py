"""Exports subsurface scattering and media inside objects as material extensions that the farm reads."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..farm.protocol.sentences import Sentence
from .model import Scene
from .nodes import constant_value, output_of
from .volumes import Medium, medium_of, volume_of

__all__ = ["MEDIUM", "SUBSURFACE", "filled", "has_volumes", "scatters", "subsurface", "world_medium"]

Warn = Callable[[str], None]
# Read by renderer/scene/readers/gltf/scattering.py.
MEDIUM, SUBSURFACE = "RAYFARM_materials_medium", "RAYFARM_materials_subsurface"
MOST_ANISOTROPY = 0.9  # Cycles' limit
LEAST, CLEAR = 1e-3, 0.999


def subsurface(surface: Any) -> dict[str, Any] | None:
    """Returns the glTF extension of a surface with subsurface scattering; None for other surfaces.

    Cycles interprets a radius as 4 pi mean free paths, or for skin as the diffusion length in a medium of the surface's colour.
    Both assume isotropic scattering; with anisotropy g, scattering must be 1 / (1 - g) times as dense. Source:
    intern/cycles/kernel/closure/bssrdf.h and kernel/integrator/subsurface_random_walk.h.
    """
    weight = _number(surface, "Subsurface Weight", 0.0)
    if weight <= LEAST:
        return None
    scale, radius = _number(surface, "Subsurface Scale", 0.05), _rgb_value(surface, "Subsurface Radius", [1.0, 0.2, 0.1])
    g = min(max(_number(surface, "Subsurface Anisotropy", 0.0), 0.0), MOST_ANISOTROPY)
    path = [max(scale * r, 0.0) / (4 * math.pi) for r in radius]
    if _number(surface, "Subsurface Skin", 0.0) > 0:
        ior = min(max(_number(surface, "Subsurface IOR", 1.4), 1.01), 3.8)
        color = _rgb_value(surface, "Base Color", [0.8] * 3)
        path = [max(scale * r, 0.0) * math.sqrt(3 * (1 - albedo_of(c, ior))) for r, c in zip(radius, color, strict=True)]
    reduced = [(1 - g) * each for each in path]
    return {"subsurfaceFactor": min(weight, 1.0), "subsurfaceRadius": reduced, "subsurfaceAnisotropy": g}


def albedo_of(color: float, ior: float) -> float:
    """Returns the reduced single-scattering albedo of a medium whose half space has this colour beneath its boundary.

    Source: Jensen et al. 2001, eq. 15.
    """
    inner = -1.440 / ior**2 + 0.710 / ior + 0.668 + 0.0636 * ior
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        root = math.sqrt(3 * (1 - middle))
        if middle / 2 * (1 + math.exp(-4 / 3 * (1 + inner) / (1 - inner) * root)) * math.exp(-root) < color:
            low = middle
        else:
            high = middle
    return low


def filled(tree: Any, lets_in: bool, warn: Warn) -> dict[str, Any] | None:
    """Returns the glTF extension with the medium inside a material with a volume shader; None if it has no volume.

    lets_in: whether the surface transmits light. If it does not, the volume is not exported, unless the material has no surface.
    """
    source = volume_of(tree)
    if source is None:
        return None
    top = output_of(tree)
    is_bare = top is None or (top.node.type == "BSDF_TRANSPARENT" and min(constant_value(top.input("Color")) or [0.0]) > CLEAR)
    found = medium_of(source, warn)
    if not is_bare and not lets_in:
        if found is not None and not found.is_nothing():
            warn(Sentence("cycles-volume-opaque", "its volume is left out, since its surface is opaque"))
        return None
    return {**_medium_json(found or Medium()), "isInterface": is_bare}


def has_volumes(scene: Scene) -> bool:
    """Returns True if the scene has scattering volumes."""
    return bool(scene.world.medium) or any(scatters(each.gltf.get("extensions", {})) for each in scene.materials.values())


def scatters(extensions: dict[str, Any]) -> bool:
    """Returns True if the interior of a material with these glTF extensions scatters light."""
    return max(extensions.get(MEDIUM, {}).get("sigmaS", [0.0])) > 0


def world_medium(tree: Any, warn: Warn) -> dict[str, Any] | None:
    """Returns the medium that fills the world, in the form of a scene file; None if there is none."""
    found = medium_of(volume_of(tree), warn)
    if found is None or found.is_nothing():
        return None
    return {"sigma_a": found.sigma_a, "sigma_s": found.sigma_s, "g": found.g}


def _medium_json(found: Medium) -> dict[str, Any]:
    return {"sigmaA": found.sigma_a, "sigmaS": found.sigma_s, "g": found.g}


def _number(surface: Any, name: str, default: float) -> float:
    found = constant_value(surface.input(name))
    return found if isinstance(found, float) else _own_value(surface, name, default)


def _own_value(surface: Any, name: str, default: float) -> float:
    """Returns the value set on an input socket, even if another node is connected to it."""
    value = getattr(getattr(surface.input(name), "socket", None), "default_value", None)
    return float(value) if isinstance(value, int | float) else default


def _rgb_value(surface: Any, name: str, default: list[float]) -> list[float]:
    found = constant_value(surface.input(name))
    if isinstance(found, list):
        return found
    if isinstance(found, float):
        return [found] * 3
    own = getattr(getattr(surface.input(name), "socket", None), "default_value", None)
    return [float(c) for c in own][:3] if hasattr(own, "__len__") else default
