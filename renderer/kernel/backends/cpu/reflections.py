"""Paths whose first ray from a catcher of reflections has arrived (renderer/kernel/steps/catch_reflections.py)."""

from __future__ import annotations

import numpy as np

from renderer.jit import device, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu.rows import Sample, camera_stream, first_rows, gather, group_row, scatter, spare_where_not
from renderer.kernel.light_paths import forget_lights
from renderer.kernel.steps import catch_reflections
from renderer.kernel.steps.catch_reflections import background_light, luminance_on_film
from renderer.kernel.steps.mis import hit_weight
from renderer.kernel.steps.record_first_hit import FirstHit, record_direct_light, record_reflection
from renderer.kernel.steps.state import with_radiance
from renderer.wide.values import any_of, not_, where, where3

__all__ = ["add_arriving_light", "is_from_catcher", "meet_objects"]

_ZERO = np.float32(0.0)


@device
def _weigh_hit(options, ray, path, last, point, light_pdf):
    return hit_weight(ray.pdf, light_pdf)


@device
def is_from_catcher(scene, pool, rows, path, options):
    """Returns a mask of the paths whose ray is the first one from a catcher of reflections."""
    found = path.number != path.number
    if scene.has.reflections is not None and options.has_mattes:
        found = catch_reflections.is_from_catcher(path, gather(pool, first_rows(pool, rows), FirstHit).caught)
    return found


@device
def add_arriving_light(scene, pool, rows, reflected, before, path, options):
    """Adds the light that paths have gathered since their radiance was `before` to that of their catchers without occlusion."""
    stream, first = camera_stream(gather(pool, rows, Sample), options), first_rows(pool, rows)
    light = luminance_on_film(scene, stream, vec.sub(path.radiance, before))
    hit = gather(pool, first, FirstHit)
    scatter(pool, spare_where_not(pool, reflected, first), record_direct_light(hit, light))


@template
def meet_objects(scene, pool, rows, meets, hides, ray, path, last, kind, time, wavelengths, options):
    """Returns the PathStates after those in `meets` have met an object: their light so far is that of their catcher.

    hides: whether the object is in front of the background. last, kind, time, wavelengths: as for `background_light`.
    """
    if any_of(meets):
        stream, first = camera_stream(gather(pool, rows, Sample), options), first_rows(pool, rows)
        hit, none = gather(pool, first, FirstHit), path.number - path.number
        hidden = background_light(scene, ray, path, last, kind, time, wavelengths, options, _weigh_hit)
        hit = record_direct_light(hit, where(hides, luminance_on_film(scene, stream, hidden), none))
        hit = record_reflection(hit, luminance_on_film(scene, stream, path.radiance))
        scatter(pool, spare_where_not(pool, meets, first), hit)
        if scene.has.by_light is not None:
            forget_lights(pool, group_row(pool, spare_where_not(pool, meets, rows), options), options)
        path = with_radiance(path, where3(not_(meets), path.radiance, (none, none, none)))
    return path
