"""Renders a batch one path at a time, with any integrator, into the film's fixed-point sums."""

from __future__ import annotations

import numpy as np

from renderer.film import CHANNELS, COLOR, COLOR_HALF, SAMPLES, SAMPLES_HALF
from renderer.jit import device, local_floats, template
from renderer.kernel import vec
from renderer.kernel.backends.scalar.first_hit import (
    FIRST_GROUP,
    FIRST_HIT_SLOTS,
    add_alpha,
    add_first_hit,
    catches_light_alone,
    forget_first_hit,
    is_finite_first_hit,
    store_record,
    store_shadow,
)
from renderer.kernel.fixed_point import fixed, in_half
from renderer.kernel.light_groups import add_to_plane, forget_groups
from renderer.kernel.light_paths import add_sample_by_light
from renderer.kernel.medium.camera_media import media_of_camera
from renderer.kernel.steps.spawn_camera_ray import spawn_camera_ray

__all__ = ["add_sample", "render_tile"]

_COLOR, _COLOR_HALF = COLOR.start, COLOR_HALF.start
_TWO = np.uint32(2)
_FIRST_GROUP = np.uintp(FIRST_GROUP)


@device
def _add_radiance(sums, channel, count, y, x, radiance, scale):
    """Adds a sample's radiance to the three planes of pixel (x, y) from `channel` on, and 1 to the plane numbered `count`."""
    sums[channel, y, x] += fixed(radiance[0], scale)
    sums[channel + 1, y, x] += fixed(radiance[1], scale)
    sums[channel + 2, y, x] += fixed(radiance[2], scale)
    sums[count, y, x] += 1


@device
def add_sample(sums, y, x, sample, radiance, hit, scale, origin):
    """Adds a sample of pixel (x, y) to the planes of colour and of the first hit.

    sample: its number. hit: the array of its first hit. origin: see Batch (renderer/kernel/accumulate.py).
    """
    _add_radiance(sums, _COLOR, SAMPLES, y, x, radiance, scale)
    if in_half(sample):
        _add_radiance(sums, _COLOR_HALF, SAMPLES_HALF, y, x, radiance, scale)
    add_first_hit(sums, y, x, hit, sample, scale, origin)


@template
def render_tile(trace, scene, stack, camera, options, batch, output):
    """Renders a batch, one path at a time; returns (number of bad samples, number of rays).

    trace: the integrator, a compile-time constant. stack: from new_stack. camera: from camera_frame. options: from
    kernel_options. batch, output: see accumulate.py. At most as many bad samples are listed as `output.bad` has rows.
    """
    sums, bad, log = output.sums, output.bad, output.log
    x0, y0, first, count = batch.x, batch.y, batch.first, batch.count
    bad_count = 0
    rays = 0
    scale = options.scale
    hit = local_floats(FIRST_HIT_SLOTS)
    pixels = np.uintp(sums.shape[1] * sums.shape[2])
    if scene.has.by_light is not None:
        hit = output.path
    medium_stack = media_of_camera(scene, stack, camera, sums.shape[1] * sums.shape[2] * count)
    for y in range(sums.shape[1]):
        for x in range(sums.shape[2]):
            for sample in range(first, first + count):
                seen = spawn_camera_ray(scene.has.motion, camera, options, x0 + x, y0 + y, np.uint32(sample))
                forget_first_hit(hit)
                if scene.has.by_light is not None:
                    forget_groups(hit, FIRST_GROUP, _TWO * options.group_rows)
                radiance, met = trace(scene, stack, seen, medium_stack, options, log, hit)
                rays += met
                if not (vec.is_finite(radiance) and is_finite_first_hit(hit)):
                    if bad_count < len(bad):
                        bad[bad_count, 0] = x0 + x
                        bad[bad_count, 1] = y0 + y
                        bad[bad_count, 2] = sample
                    bad_count += 1
                    continue
                caught = options.has_mattes and catches_light_alone(hit)
                if caught:  # a shadow is black
                    store_shadow(hit, radiance)
                    radiance = vec.sub(radiance, radiance)
                add_sample(sums, y, x, sample, radiance, hit, scale, batch.origin)
                if scene.has.by_light is not None and not caught:
                    place = np.uintp(CHANNELS) * pixels + np.uintp(y * sums.shape[2] + x)
                    rows, counts = (_FIRST_GROUP, _FIRST_GROUP + np.uintp(options.group_rows)), (options.groups, options.paths)
                    add_sample_by_light(output.flat, place, pixels, hit, rows, counts, radiance, scale, add_to_plane)
                if options.transparent_background:
                    add_alpha(sums, y, x, hit, scale)
                if len(output.records) > 0:
                    store_record(output.records, (y * sums.shape[2] + x) * count + sample - first, hit, radiance)
    return bad_count, rays
