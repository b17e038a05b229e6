"""For scenes with CausticTables: samples the light of small lamps through casters at the paths' vertices.

That is done one path at a time, since walks and photons differ too much in length. `sample_caustics` samples the light before
the paths are scattered; `add_caustics` adds it after that of the shadow rays, in the order of the scalar backend.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import DIFFUSE as _LAMBERT
from renderer.arrays.rows import LAYER_SLOTS
from renderer.bvh.traverse import Hit
from renderer.jit import device, local_floats, never_inline, subroutine, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu.lists import DIFFUSE, LIT, MEDIUM_VERTICES, RARE_SPECULAR, eight_rows, length, pad, row
from renderer.kernel.backends.cpu.rows import (
    Appearance,
    Axes,
    CausticPath,
    EarlierVertex,
    Facet,
    Mapped,
    RowHit,
    Shading,
    caustic_row,
    gather,
    gather_caustic,
    last_vertex,
    path_wavelengths,
    scatter,
    scatter_caustic,
    streams_of,
    surface_of,
    time_of,
)
from renderer.kernel.backends.scalar.light import caustic_light
from renderer.kernel.manifold.chain import NO_CHAIN, begin_chain, continue_chain, is_joined, is_sampled_elsewhere
from renderer.kernel.material.material import material_with
from renderer.kernel.steps.scatter import Bounce
from renderer.kernel.steps.state import Crossings, LastVertex, PathState, Ray, Vertex, with_radiance
from renderer.kernel.surface.surface import NO_OBJECT
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, as_wide, u32, where, zero_like

__all__ = [
    "add_caustic",
    "add_caustics",
    "arrive_with_chain",
    "chain_of",
    "has_sampled_caustic",
    "leave_with_chain",
    "sample_caustic",
    "sample_caustics",
]

_ZERO = np.float32(0.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_NO_COUNTS = (_ZERO, _ZERO, _ZERO, _ZERO)
_NO_CHAIN = np.uint32(NO_CHAIN)
_DIFFUSE, _IN_MEDIUM, _RARE_SPECULAR = np.uint32(DIFFUSE), np.uint32(MEDIUM_VERTICES), np.uint32(RARE_SPECULAR)


@device
def chain_of(pool, rows, path, options):
    """Returns the state of the chains with which the rays of one path or of eight arrive. path: their PathState."""
    stored = gather_caustic(pool, caustic_row(pool, rows, options), CausticPath).chain
    return where(path.number == _ZERO, as_wide(_NO_CHAIN, path.number), stored)  # no row is written for a camera ray


@device
def arrive_with_chain(scene, pool, rows, chain, through, options):
    """Keeps what `sample_caustic` needs of the vertices that eight paths have left; called before their new ones are stored.

    chain: from `chain_of`. through: whether each path passes through what it has hit, which ends its chain.
    """
    last = last_vertex(scene, pool, rows)
    none = zero_like(last.point[0])
    arrived = where(through, as_wide(_NO_CHAIN, none), chain)
    scatter(pool, rows, EarlierVertex(last.point, last.normal))
    scatter_caustic(pool, caustic_row(pool, rows, options), CausticPath(arrived, (none, none, none)))


@subroutine
def _is_sampled_elsewhere(scene, chain, light):
    never_inline()
    return is_sampled_elsewhere(scene, np.int32(chain), np.int64(light))


@device
def has_sampled_caustic(scene, chain, light, wanted):
    """Returns True where manifold sampling has already sampled the emission that one path hits, or each of eight.

    chain: from `chain_of`. light: index of the light. wanted: the lanes of interest; others get False.
    """
    return each_lane(_is_sampled_elsewhere, wanted & (chain != _NO_CHAIN), (scene, chain, light))


@subroutine
def _continued(scene, chain, t, primitive, u, v, instance, o, d, has_left, reflected):
    never_inline()
    hit = Hit(t, np.int32(primitive), u, v, np.int32(instance), None)
    return u32(continue_chain(scene, np.int32(chain), hit, o, d, Bounce(has_left, reflected, _ZERO)))


@device
def leave_with_chain(scene, pool, rows, written, specular, bounce, options):
    """Writes the state of the chains with which one path or eight leave their vertices; called before their next rays are stored.

    written: the rows of the branches that leave. specular: whether each vertex is. bounce: the Bounces there.
    """
    kept, met = gather_caustic(pool, caustic_row(pool, rows, options), CausticPath), gather(pool, rows, RowHit)
    chain = kept.chain  # at other vertices that of `sample_caustic`
    if any_of(specular):
        hit, ray = (met.t, met.primitive, met.u, met.v, met.instance), gather(pool, rows, Ray)
        known = scene, chain, *hit, ray.o, ray.d, bounce.has_left, bounce.reflected
        chain = where(specular, each_lane(_continued, specular & (chain != _NO_CHAIN), known), chain)
    scatter_caustic(pool, caustic_row(pool, written, options), CausticPath(chain, kept.light))


@device
def _vertex_of(scene, pool, number, ray, shading, layers, options):
    """Returns the Vertex of the path in row `number`. layers: (LAYER_SLOTS,) float32, receives rarer materials' parameters."""
    surface, seen = surface_of(pool, number, gather(pool, number, Facet), shading), gather(pool, number, Appearance)
    axes, n = gather(pool, number, Axes), gather(pool, number, Mapped).normal
    frame, time = (axes.s, axes.t, n), time_of(scene.has.motion, pool, number)
    kind = scene.material_kind[surface.material]
    if shading.list == _DIFFUSE:  # also where a subsurface walk has ended
        kind = np.int32(_LAMBERT)
    known = kind, seen.base, seen.metallic, seen.roughness, seen.eta, frame
    material = material_with(scene, surface, *known, layers, time, path_wavelengths(scene, pool, number, options))
    wo = vec.to_local(axes.s, axes.t, n, vec.neg(ray.d))
    return Vertex(surface, frame, material, wo, last_vertex(scene, pool, number).normal)


@template
def sample_caustic(scene, stack, pool, number, layers, spare, options):
    """Samples the light through casters at the vertex of the path in row `number`, which is not specular.

    Writes CausticPath; returns the number of rays traced. layers, spare: (LAYER_SLOTS,) float32, scratch memory.
    """
    shading, ray, path = gather(pool, number, Shading), gather(pool, number, Ray), gather(pool, number, PathState)
    light, rays = _BLACK, 0
    begun = NO_CHAIN
    if shading.list != _IN_MEDIUM:
        vertex = _vertex_of(scene, pool, number, ray, shading, layers, options)
        begun = begin_chain(vertex.material, False)
        if is_joined(vertex.material):
            before, counts = gather(pool, number, EarlierVertex), _NO_COUNTS
            last, chain = LastVertex(before.point, before.normal, NO_OBJECT), np.int32(chain_of(pool, number, path, options))
            if options.has_depths:
                counts = gather(pool, number, Crossings).counts
            stream, time = streams_of(pool, number, options), time_of(scene.has.motion, pool, number)
            wavelengths = path_wavelengths(scene, pool, number, options)
            known = vertex, ray, path, last, chain, counts, options, stream, spare, time, wavelengths
            light, rays = caustic_light(scene, stack, *known)
    scatter_caustic(pool, caustic_row(pool, number, options), CausticPath(u32(begun), light))
    return rays


@subroutine
def sample_caustics(scene, alone, pool, lists, options):
    """Samples the light through casters at the vertices on the list LIT, by `sample_caustic`; returns the number of rays."""
    never_inline()
    layers, spare = local_floats(LAYER_SLOTS), local_floats(LAYER_SLOTS)
    rays = np.int64(0)
    for k in range(length(lists, LIT)):
        rays += sample_caustic(scene, alone, pool, row(lists, LIT, k), layers, spare, options)
    return rays


@device
def add_caustic(pool, rows, options):
    """Adds the light through casters that `sample_caustic` has sampled to the paths in one row of the pool or in eight."""
    path, light = gather(pool, rows, PathState), gather_caustic(pool, caustic_row(pool, rows, options), CausticPath).light
    scatter(pool, rows, with_radiance(path, vec.add(path.radiance, light)))


@subroutine
def add_caustics(pool, lists, options):
    """Adds the light through casters to the paths on the list LIT, as `add_caustic` does."""
    never_inline()
    for k in range(0, pad(lists, LIT), 8):
        add_caustic(pool, eight_rows(lists, LIT, k), options)
