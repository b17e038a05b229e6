"""Finds the media that contain the camera, by tracing a ray and listing the surfaces that it leaves from inside."""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, closest_hit
from renderer.jit import device, never_inline, subroutine
from renderer.kernel.camera import camera_ray, moving_ray
from renderer.kernel.medium.medium_stack import NO_MEDIUM, beneath, entered, holds, left
from renderer.kernel.surface.surface import surface_at
from renderer.prune_absent_features import where_present
from renderer.wide.values import u32

__all__ = ["media_of_camera"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_INF = np.float32(np.inf)
_ROOT = np.int32(0)
_WORLD, _NEXT = np.uint32(0), np.uint32(1)
_MIDDLE = (_HALF, _HALF)
# An arbitrary direction, not parallel to typical walls.
_UPWARDS = (np.float32(0.36), np.float32(0.8), np.float32(0.48))


@subroutine
def _media_at(scene, stack, o, time):
    """Returns the stack of media that contain the world point o.

    These are the media of the bodies that a fixed ray from o leaves from inside without having entered them.
    """
    never_inline()
    medium_stack, on_the_way, depth = _WORLD, _WORLD, _WORLD
    after = FROM_ORIGIN
    while True:
        hit = closest_hit(scene.bvh, stack, o, _UPWARDS, _INF, time, _ROOT, after)
        if hit.primitive == NO_PRIMITIVE:
            break
        surface = surface_at(scene, o, _UPWARDS, hit)
        medium = u32(scene.material_medium[surface.material])
        if medium != NO_MEDIUM:
            if surface.front:
                on_the_way = entered(on_the_way, u32(medium + _NEXT))  # plus 1, since 0 is the world's medium
            elif holds(on_the_way, u32(medium + _NEXT)):
                on_the_way = left(on_the_way, u32(medium + _NEXT))
            else:
                medium_stack = beneath(medium_stack, depth, medium)
                depth = u32(depth + _NEXT)
        after = hit.t, hit.instance, hit.primitive
    return medium_stack


@device
def media_of_camera(scene, stack, camera, samples):
    """Returns the stack of media with which all paths of an image begin.

    It is that of the point where the central ray starts, in the middle of the shutter interval; 0 for a scene without media.
    samples: number of samples in the batch; if it is 0, no ray is traced.
    """
    medium_stack = _WORLD
    if scene.has.media is not None:
        x, y = camera.middle
        o, _, _ = camera_ray(camera, x, y, _MIDDLE)
        if scene.has.motion is not None:
            o, _, _ = moving_ray(camera, x, y, _MIDDLE, _HALF)
        if len(scene.medium) > 1 and samples > 0:
            medium_stack = _media_at(scene, stack, o, where_present(scene.has.motion, _HALF))
    return medium_stack
