"""Renders a batch one path at a time, with any integrator, into the film's fixed-point sums."""

from __future__ import annotations

import numpy as np

from renderer.film import (
    ALBEDO,
    COLOR,
    COLOR_HALF,
    DEPTH,
    MATERIAL,
    NORMAL,
    OBJECT,
    POSITION,
    SAMPLES,
    SAMPLES_HALF,
)
from renderer.jit import device, local_floats, template
from renderer.kernel import vec
from renderer.kernel.backends.scalar.first_hit import FIRST_HIT_SLOTS, forget_first_hit, load_first_hit
from renderer.kernel.fixed_point import fixed, in_half
from renderer.kernel.medium.camera_media import media_of_camera
from renderer.kernel.steps.spawn_camera_ray import spawn_camera_ray

__all__ = ["render_tile"]

_COLOR, _COLOR_HALF, _ALBEDO, _NORMAL = COLOR.start, COLOR_HALF.start, ALBEDO.start, NORMAL.start
_POSITION = POSITION.start
_ZERO = np.float32(0.0)
_NOTHING = (np.int64(0), np.int64(0), np.int64(0))


@device
def _fixed3(value, scale):
    return fixed(value[0], scale), fixed(value[1], scale), fixed(value[2], scale)


@device
def _sum3(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@device
def _add3(sums, channel, y, x, value):
    sums[channel, y, x] += value[0]
    sums[channel + 1, y, x] += value[1]
    sums[channel + 2, y, x] += value[2]


@template
def render_tile(trace, scene, stack, camera, options, batch, output):
    """Renders a batch, one path at a time; returns (number of bad samples, number of rays).

    trace: the integrator, a compile-time constant; stack: from new_stack; camera: from camera_frame; options: from
    kernel_options; batch, output: as in accumulate.py. As many bad samples are listed as `output.bad` has rows.
    """
    sums, bad, log = output.sums, output.bad, output.log
    x0, y0, first, count = batch.x, batch.y, batch.first, batch.count
    bad_count = 0
    rays = 0
    scale = options.scale
    hit = local_floats(FIRST_HIT_SLOTS)
    medium_stack = media_of_camera(scene, stack, camera, sums.shape[1] * sums.shape[2] * count)
    for y in range(sums.shape[1]):
        for x in range(sums.shape[2]):
            color = half = albedo = normal = position = _NOTHING
            object_id = material_id = depth = samples = samples_half = np.int64(0)
            for sample in range(first, first + count):
                seen = spawn_camera_ray(scene.has.motion, camera, options, x0 + x, y0 + y, np.uint32(sample))
                forget_first_hit(hit)
                radiance, met = trace(scene, stack, seen, medium_stack, options, log, hit)
                rays += met
                base, distance, upright, object_number, place, material_number = load_first_hit(hit)
                finite = vec.is_finite(radiance) and vec.is_finite(upright) and vec.is_finite(base)
                if not (finite and vec.is_finite(place)):
                    if bad_count < len(bad):
                        bad[bad_count, 0] = x0 + x
                        bad[bad_count, 1] = y0 + y
                        bad[bad_count, 2] = sample
                    bad_count += 1
                    continue
                value = _fixed3(radiance, scale)
                color = _sum3(color, value)
                albedo = _sum3(albedo, _fixed3(base, scale))
                normal = _sum3(normal, _fixed3(upright, scale))
                position = _sum3(position, _fixed3(place, scale))
                if distance > _ZERO:
                    position = _sum3(position, batch.origin)
                depth += fixed(distance, scale)
                samples += 1
                if sample == 0:  # ids cannot be averaged, so the first sample decides
                    object_id = np.int64(object_number)
                    material_id = np.int64(material_number)
                if in_half(sample):
                    half = _sum3(half, value)
                    samples_half += 1
            # Once a pixel, not once a sample: the planes of a tile evict each other from the cache.
            _add3(sums, _COLOR, y, x, color)
            _add3(sums, _COLOR_HALF, y, x, half)
            _add3(sums, _ALBEDO, y, x, albedo)
            _add3(sums, _NORMAL, y, x, normal)
            _add3(sums, _POSITION, y, x, position)
            sums[OBJECT, y, x] += object_id
            sums[MATERIAL, y, x] += material_id
            sums[DEPTH, y, x] += depth
            sums[SAMPLES, y, x] += samples
            sums[SAMPLES_HALF, y, x] += samples_half
    return bad_count, rays
