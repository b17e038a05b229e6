"""The kind of a path's ray, in scenes where objects or lights are visible to some kinds of rays only.

As in Cycles the kind is that of the lobe which the ray has left: diffuse and glossy for reflections, transmission, or volume for
a vertex in a medium. A ray of a kind meets only the objects that are visible to that kind: it starts at the kind's root node.
Lobe k of a vertex thus receives the radiance L_k, and the vertex sends back the sum over k of the integral of f_k L_k.

A reflected direction belongs to the diffuse and to the glossy lobes of its material. One of the two is chosen in proportion to
its value, summed over the channels; the path continues with that lobe's value alone, divided by the probability. So the density
of a direction stays that of the whole material, and MIS weights hold for each lobe: light sampling counts the lobes whose rays
see the light, with the weight of its direction. A direction with pdf 0 is glossy.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.layout import RAY_KINDS
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.light.visibility import is_seen
from renderer.kernel.light_paths import diffuse_fraction
from renderer.kernel.steps.random_blocks import draw_kind
from renderer.wide.values import as_wide, u32, where, where3, zero_like

__all__ = ["RayKind", "after_vertex", "visible_lobes"]

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_DIFFUSE, _GLOSSY, _TRANSMISSION, _VOLUME = (
    np.uint32(RAY_KINDS.index(name)) for name in ("diffuse", "glossy", "transmission", "volume")
)


class RayKind(NamedTuple):
    """The kind of the ray that leaves a vertex, and what the choice of its lobe changes."""

    kind: Any  # an index into RAY_KINDS
    factor: Any  # of the path's throughput, rgb
    diffuse: Any  # the diffuse lobes' value in the direction; rgb, of the value of the lobes that the path continues with
    value: Any  # that value, rgb


@device
def after_vertex(scene, stream, number, second, diffuse, f, wi, is_surface):
    """Returns the RayKind of a ray that a vertex scatters into the local direction wi.

    number: count of earlier vertices. second: whether the ray is that of the second branch. diffuse, f: f |cos| of the diffuse
    lobes and of all, 0 for a discrete direction. is_surface: False for a vertex in a medium.
    """
    none = zero_like(wi[2])
    one = none + _ONE
    white, black = (one, one, one), (none, none, none)
    part = diffuse_fraction(diffuse, f)
    whole = f[0] + f[1] + f[2]
    chance = where(whole > _ZERO, (part[0] * f[0] + part[1] * f[1] + part[2] * f[2]) / whole, none)
    u = draw_kind(stream, number)
    is_diffuse, is_reflected = (u[1] if second else u[0]) < chance, is_surface & (wi[2] > _ZERO)
    beyond = where(is_surface, as_wide(_TRANSMISSION, none), as_wide(_VOLUME, none))
    kind = u32(where(is_reflected, where(is_diffuse, as_wide(_DIFFUSE, none), as_wide(_GLOSSY, none)), beyond))
    if scene.bvh.ray_roots[_DIFFUSE] == scene.bvh.ray_roots[_GLOSSY]:  # both see the same: no choice is needed
        return RayKind(kind, white, diffuse, f)
    rest = vec.scale(vec.sub(white, part), one / (one - chance))
    factor = where3(is_reflected, where3(is_diffuse, vec.scale(part, one / chance), rest), white)
    value = vec.mul(f, factor)
    return RayKind(kind, factor, where3(is_reflected, where3(is_diffuse, value, black), diffuse), value)


@device
def visible_lobes(word, diffuse, f, wi, is_surface):
    """Returns (diffuse, f) of the lobes whose rays see the light with this word, by which its sample is weighted.

    diffuse, f, wi, is_surface: as for `after_vertex`, for the light's direction.
    """
    none = zero_like(wi[2])
    black = none, none, none
    by_diffuse, by_glossy = is_seen(word, _DIFFUSE), is_seen(word, _GLOSSY)
    seen = where3(by_diffuse, where3(by_glossy, f, diffuse), where3(by_glossy, _rest(f, diffuse), black))
    is_beyond = where(is_surface, is_seen(word, _TRANSMISSION), is_seen(word, _VOLUME))
    is_reflected = is_surface & (wi[2] > _ZERO)
    f = where3(is_reflected, seen, where3(is_beyond, f, black))
    keeps = where(is_reflected, by_diffuse, is_beyond)
    return where3(keeps, diffuse, black), f


@device
def _rest(f, diffuse):
    """Returns f without the diffuse lobes, at least 0."""
    none = zero_like(f[0])
    return max(f[0] - diffuse[0], none), max(f[1] - diffuse[1], none), max(f[2] - diffuse[2], none)
