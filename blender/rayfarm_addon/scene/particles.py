"""Reads the strands of particle hair: its paths, with children, and the radius along them.

Radii, and the choice of parents and children, are as in Cycles (intern/cycles/blender/curves.cpp).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["MOST_POINTS", "Strands", "hair_systems", "strands_of"]

F32 = npt.NDArray[np.float32]
MOST_POINTS = 1_000_000


class Strands(NamedTuple):
    """The strands of a particle system, in the space of its object, as `tubes` takes them."""

    points: F32  # (P, 3), strand by strand
    radii: F32  # (P,)
    first: npt.NDArray[np.int32]  # (S + 1,) the first point of each strand, followed by P


def hair_systems(thing: Any, for_render: bool) -> Iterator[Any]:
    """Yields the particle systems of an object that are shown as hair. for_render: whether by their visibility in renders."""
    modifiers = [each for each in thing.modifiers if each.type == "PARTICLE_SYSTEM"]
    shown = {each.particle_system.name for each in modifiers if (each.show_render if for_render else each.show_viewport)}
    for system in thing.particle_systems:
        if system.name in shown and system.settings.type == "HAIR" and system.settings.render_type == "PATH":
            yield system


def strands_of(thing: Any, system: Any, for_render: bool) -> Strands | None:
    """Returns the strands of an evaluated object's hair; None without strands or with more than MOST_POINTS points.

    thing: a bpy.types.Object. system: one of its particle systems, as evaluated.
    for_render: whether paths are as fine as in renders, as they are in a dependency graph for rendering.
    """
    settings = system.settings
    parents, children = len(system.particles), len(system.child_particles)
    begin = 0 if settings.child_type == "NONE" or settings.use_parent_particles or not children else parents
    count = parents + children - begin
    steps = (1 << (settings.render_step if for_render else settings.display_step)) + 1
    if settings.kink == "SPIRAL":
        steps += settings.kink_extra_steps
    if not 0 < count * steps <= MOST_POINTS:
        return None
    co_hair = system.co_hair
    world = np.array(
        [tuple(co_hair(thing, particle_no=k, step=s)) for k in range(begin, begin + count) for s in range(steps)], np.float64
    ).reshape(count, steps, 3)
    for s in range(1, steps):  # a path that is shorter is followed by zeros
        world[:, s] = np.where(world[:, s].any(axis=1, keepdims=True), world[:, s], world[:, s - 1])
    inverse = np.array(thing.matrix_world.inverted_safe(), np.float64)
    points = world @ inverse[:3, :3].T + inverse[:3, 3]
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
    kept = np.concatenate([np.ones((count, 1), bool), lengths > 0], axis=1)
    along = np.concatenate([np.zeros((count, 1)), np.cumsum(lengths, axis=1)], axis=1)
    whole = along[:, -1:]
    radii = _radii(settings, along / np.where(whole > 0, whole, 1))
    if settings.use_close_tip:
        last = steps - 1 - np.argmax(kept[:, ::-1], axis=1)
        radii[np.arange(count), last] = 0
    kept &= whole > 0
    sizes = kept.sum(axis=1)
    first = np.concatenate([[0], np.cumsum(sizes[sizes > 0])]).astype(np.int32)
    if first[-1] == 0:
        return None
    return Strands(points[kept].astype(np.float32), radii[kept].astype(np.float32), first)


def _radii(settings: Any, share: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Returns the radii at shares of a strand's length, 0 at its root."""
    shape = min(max(settings.shape, -0.999), 0.999)
    bent = np.clip(1 - share, 0, 1) ** (1 + shape if shape < 0 else 1 / (1 - shape))
    root, tip = (0.5 * settings.radius_scale * each for each in (settings.root_radius, settings.tip_radius))
    return np.asarray(bent * (root - tip) + tip)
