"""Renders a batch, all pixels of a tile over a range of sample numbers, into fixed-point sums."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import typeof

from renderer.arrays.scene import CompiledScene
from renderer.bvh.traverse import new_stack
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
from renderer.jit import device, entry, local_floats, never_inline, subroutine, template
from renderer.kernel import vec
from renderer.kernel.backends.cpu.render import Part, pool_for, render_with_pool, stages
from renderer.kernel.backends.scalar.first_hit import FIRST_HIT_SLOTS, forget_first_hit, load_first_hit
from renderer.kernel.camera import camera_frame
from renderer.kernel.fixed_point import fixed, in_half
from renderer.kernel.lineage.ao import trace_ao
from renderer.kernel.lineage.path import trace_special_path
from renderer.kernel.lineage.whitted import trace_whitted
from renderer.kernel.medium.camera_media import media_of_camera
from renderer.kernel.options import is_special, kernel_options
from renderer.kernel.path_trace import COLUMNS
from renderer.kernel.steps.spawn_camera_ray import spawn_camera_ray
from renderer.reference import Reference, by_reference
from renderer.settings import RenderSettings

__all__ = ["MAX_BAD", "Batch", "Output", "has_editions", "new_scratch", "parts_of_pictures", "renderer_of"]

Renderer = Callable[..., tuple[int, int]]

MAX_BAD = 64  # bad samples that are reported; further ones are only counted

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


class Batch(NamedTuple):
    """The samples to render: `count` from number `first` on, for each pixel of a tile with its corner at (x, y).

    origin: the compiled scene's origin in the film's fixed point; added to the position of each first hit.
    """

    x: int
    y: int
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which is not used
    origin: tuple[int, int, int] = (0, 0, 0)


class Output(NamedTuple):
    """The arrays to which a batch is written."""

    sums: npt.NDArray[np.int64]  # (CHANNELS, h, w), added to; its size is the tile's
    bad: npt.NDArray[np.int64]  # (MAX_BAD, 3): x, y and number of samples that were NaN or infinite and so left out
    log: npt.NDArray[np.float64]  # rows for the last sample's path_trace.py, or none


@template
def _render_tile(trace, scene, stack, camera, options, batch, output):
    """Renders a batch, one path at a time; returns (number of bad samples, number of rays).

    trace: the integrator, a compile-time constant; stack: from new_stack; camera: from camera_frame; options: from
    kernel_options.
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
                    if bad_count < MAX_BAD:
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


# Each is compiled at its first call. For frames there is a path tracer without other features, which follows many
# paths at once.


# The scene is handed to what does the work by reference (renderer/reference.py).


@subroutine
def _with_pool(scene, pool, camera, options, batch, output):
    never_inline()
    return render_with_pool(scene, pool, camera, options, batch, output)


@subroutine
def _by_path(scene, stack, camera, options, batch, output):
    never_inline()
    return _render_tile(trace_special_path, scene, stack, camera, options, batch, output)


@subroutine
def _by_whitted(scene, stack, camera, options, batch, output):
    never_inline()
    return _render_tile(trace_whitted, scene, stack, camera, options, batch, output)


@subroutine
def _by_ao(scene, stack, camera, options, batch, output):
    never_inline()
    return _render_tile(trace_ao, scene, stack, camera, options, batch, output)


@entry
def _render_pool(scene, pool, camera, options, batch, output):
    return _with_pool(by_reference(scene), pool, camera, options, batch, output)


@entry
def _render_special_path(scene, stack, camera, options, batch, output):
    return _by_path(by_reference(scene), stack, camera, options, batch, output)


@entry
def _render_whitted(scene, stack, camera, options, batch, output):
    return _by_whitted(by_reference(scene), stack, camera, options, batch, output)


@entry
def _render_ao(scene, stack, camera, options, batch, output):
    return _by_ao(by_reference(scene), stack, camera, options, batch, output)


def has_editions(settings: RenderSettings) -> bool:
    """Whether the kernel for these settings has editions with fewer features: only the pool path tracer does.

    The other kernels are compiled with all features, so that each compiles only once.
    """
    return renderer_of(settings) is _render_pool


def renderer_of(settings: RenderSettings) -> Renderer:
    """Returns the kernel for these settings. Direct lighting is path tracing with two segments."""
    if settings.integrator == "whitted":
        return _render_whitted
    if settings.integrator == "ao":
        return _render_ao
    if is_special(settings):
        return _render_special_path
    return _render_pool


def parts_of_pictures(scene: CompiledScene, settings: RenderSettings) -> list[Part]:
    """Returns the parts of the pool path tracer that take longest to compile, as listed by `stages`.

    scene: an empty scene of the wanted edition.
    """
    sums, bad, log = np.zeros((1, 0, 0), np.int64), np.zeros((0, 3), np.int64), np.zeros((0, COLUMNS))
    given = pool_for(0, 0), camera_frame(settings), kernel_options(settings, scene), Batch(0, 0, 0, 0), Output(sums, bad, log)
    return stages(scene.has, Reference(typeof(scene)), *given)


def new_scratch(renderer: Renderer, width: int, height: int) -> Any:
    """Returns the scratch memory that a kernel needs for a batch of a tile of that size."""
    return pool_for(width, height) if renderer is _render_pool else new_stack()
