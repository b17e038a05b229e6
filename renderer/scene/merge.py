"""Merges one description into another: appends its lists and offsets its indices."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from renderer.scene.description import Instance, SceneDescription, SurfaceNote

__all__ = ["merge"]


def merge(part: SceneDescription, target: SceneDescription, material: int | None = None) -> list[Instance]:
    """Adds the meshes of the description `part` to `target`, with the materials, textures and images that they refer to.

    Returns instances that place the meshes as in `part`; they are not yet added to `target`. material: index of a material of
    `target` that replaces the meshes' own. Lights, cameras and environment of `part` are ignored.
    """
    images, textures, materials, meshes = (len(x) for x in (target.images, target.textures, target.materials, target.meshes))
    idle = SurfaceNote if material is not None else ()
    known = set(target.warnings)
    target.warnings += [w for w in part.warnings if w not in known and not isinstance(w, idle)]
    if material is None:

        def shifted_texture(index: int | None) -> int | None:
            return None if index is None else index + textures

        target.images += part.images
        for t in part.textures:
            layers = tuple(replace(layer, texture=layer.texture + textures) for layer in t.layers)
            target.textures.append(replace(t, image=t.image + images, layers=layers))
        for m in part.materials:
            textured: dict[str, Any] = {
                f.name: shifted_texture(getattr(m, f.name)) for f in fields(m) if f.name.endswith("_texture")
            }
            target.materials.append(replace(m, **textured))
    for mesh in part.meshes:
        target.meshes.append(replace(mesh, material=mesh.material + materials if material is None else material))
    shown = []
    for instance in part.instances:
        own = instance.material
        number = None if own is None or material is not None else own + materials
        shown.append(Instance(instance.mesh + meshes, instance.transform, number, instance.name, instance.moves))
    return shown
