"""Packs the media inside objects and around them into table rows: renderer/arrays/rows.py names their columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.arrays import rows
from renderer.errors import SceneError
from renderer.scene.description import F32, I32, Medium, SceneDescription
from renderer.scene.material import MOST_DENSE, MOST_FORWARD, Material
from renderer.scene.volumes import volume_numbers
from renderer.sentences import Sentence

__all__ = ["Media", "absorption", "list_media"]

_LEAST_COLOR = 1e-6  # minimum transmitted colour of volumes, so that absorption stays finite


class Media(NamedTuple):
    """The media tables of CompiledScene. If nothing scatters and only glass absorbs, they have one row: the medium of the world.

    Kernels compiled without media then compute the absorption in glass.
    """

    medium: F32  # (m, MEDIUM_COLUMNS): first the world's, then each distinct one
    material_medium: I32  # (M,): the row of a material's interior; -1 for those that have none


def list_media(description: SceneDescription) -> Media:
    """Returns the scene's media. Raises SceneError if there are too many."""
    materials = description.materials
    own = np.zeros((len(materials), rows.MEDIUM_COLUMNS), np.float32)
    own[:, rows.SIGMA_A : rows.SIGMA_A + 3] = absorption(materials)
    own[:, rows.SIGMA_S : rows.SIGMA_S + 3] = np.array([m.sigma_s for m in materials]).reshape(-1, 3)
    own[:, rows.PHASE_G] = [m.g for m in materials]
    volumes = volume_numbers(description)
    own[:, rows.MEDIUM_VOLUME] = [volumes[m.volume] + 1 if m.volume else 0 for m in materials]
    world = np.zeros((1, rows.MEDIUM_COLUMNS), np.float32)
    around = description.medium
    if around is not None:
        _check(around)
        world[0, :7] = (*around.sigma_a, *around.sigma_s, around.g)
        world[0, rows.MEDIUM_VOLUME] = volumes[around.volume] + 1 if around.volume else 0
    inside = np.array([_has_inside(m) for m in materials], bool)
    scatters = own[:, rows.SIGMA_S : rows.SIGMA_S + 3].any(axis=1)
    fills = np.array([m.kind == "interface" for m in materials], bool) & own[:, :6].any(axis=1)
    scatters |= own[:, rows.MEDIUM_VOLUME] > 0
    if not (world[0, :6].any() or world[0, rows.MEDIUM_VOLUME]) and not (inside & (scatters | fills)).any():
        return Media(np.zeros_like(world), np.full(len(materials), -1, np.int32))
    known = {_key(world[0]): 0}
    found = [world[0]]
    of_material = np.full(len(materials), -1, np.int32)
    for i in np.flatnonzero(inside):
        key = _key(own[i])
        if key not in known:
            known[key] = len(found)
            found.append(own[i])
        of_material[i] = known[key]
    if len(found) >= rows.MOST_MEDIA:
        raise SceneError(
            Sentence(
                "scene-media-too-many",
                "The scene has {count} different media; at most {most} are supported. Let materials share media",
                count=len(found),
                most=rows.MOST_MEDIA - 1,
            )
        )
    return Media(np.array(found, np.float32), of_material)


def _check(world: Medium) -> None:
    for name, values in (("sigma_a", world.sigma_a), ("sigma_s", world.sigma_s)):
        if len(values) != 3 or not all(0 <= value <= MOST_DENSE for value in values):
            raise SceneError(
                Sentence(
                    "world-medium-value-invalid",
                    "The world's medium: its {name} is {values}; it needs three numbers from 0 to {most}",
                    name=name,
                    values=values,
                    most=f"{MOST_DENSE:g}",
                )
            )
    if not abs(world.g) <= MOST_FORWARD:
        raise SceneError(
            Sentence(
                "world-medium-g-invalid",
                "The world's medium: its g is {g}; it must be from {least} to {most}",
                g=f"{world.g:g}",
                least=f"{-MOST_FORWARD:g}",
                most=f"{MOST_FORWARD:g}",
            )
        )


def absorption(materials: list[Material]) -> np.ndarray:
    """Returns the absorption coefficients of the materials' insides, (M, 3) per unit length: sigma_a plus that of `attenuation`.

    Attenuation: white light has the colour attenuation_color after attenuation_distance.
    """
    color = np.array([m.attenuation_color for m in materials], np.float64).reshape(-1, 3)
    distance = np.array([m.attenuation_distance for m in materials], np.float64)
    own = np.array([m.sigma_a for m in materials], np.float64).reshape(-1, 3)
    return own - np.log(np.clip(color, _LEAST_COLOR, 1.0)) / np.maximum(distance, 1e-30)[:, None]


def _key(row: np.ndarray) -> bytes:
    """Returns a key that is equal for equal media: the bytes of the table row, ignoring g if the medium does not scatter.

    row: of the media table.
    """
    volume = row[rows.MEDIUM_VOLUME :].tobytes()
    return (row if row[rows.SIGMA_S : rows.SIGMA_S + 3].any() else row[: rows.SIGMA_S]).tobytes() + volume


def _has_inside(m: Material) -> bool:
    """Returns True if the material's surface bounds an interior that transmitted light enters."""
    if m.kind == "interface":
        return True
    if m.thin or m.kind not in ("glass", "metallic_roughness"):
        return False
    filled = any(m.sigma_s) or any(m.sigma_a) or m.volume
    return m.kind == "glass" or m.transmission > 0 or (m.diffuse_transmission > 0 and bool(filled))
