"""Traces rays from surface to surface, to find any that leave a closed room or hit the surface they start from."""

from __future__ import annotations

import numpy as np

from renderer.arrays.scene import CompiledScene
from renderer.bvh.traverse import NO_PRIMITIVE, any_hit, closest_hit, new_stack
from renderer.jit import entry, subroutine
from renderer.kernel import vec
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere
from renderer.kernel.surface.ray_origins import offset_ray_origin
from renderer.kernel.surface.surface import surface_at
from renderer.reference import Packed, by_reference
from tests.renderer.builders import as_rendered
from tests.renderer.kernel.subject import many

_FAR = np.float32(np.inf)


@subroutine
def _wander_all(scene, stack, o, d, u, bounces):
    for i in range(len(o)):
        origin = (o[i, 0], o[i, 1], o[i, 2])
        direction = (d[i, 0], d[i, 1], d[i, 2])
        bounces[i] = 0
        for b in range(u.shape[1]):
            hit = closest_hit(scene.bvh, stack, origin, direction, _FAR, None)
            if hit.primitive == NO_PRIMITIVE:
                break
            bounces[i] += 1
            surface = surface_at(scene, origin, direction, hit)
            s, t = vec.basis(surface.geometric)
            local = square_to_cosine_hemisphere((u[i, b, 0], u[i, b, 1]))
            direction = vec.to_world(s, t, surface.geometric, local)
            origin = offset_ray_origin(surface, True, direction)


@entry
def _wander(scene, stack, o, d, u, bounces):
    _wander_all(by_reference(scene), stack, o, d, u, bounces)


def wander(scene: CompiledScene, o: np.ndarray, count: int, bounces: int, seed: int = 0) -> np.ndarray:
    """Returns the number of bounces of each of `count` paths from o (3,) before a miss; `bounces` if it never missed."""
    rng = np.random.default_rng(seed)
    d = rng.standard_normal((count, 3))
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    done = np.zeros(count, np.int64)
    origin = many(o, count)
    _wander(Packed(as_rendered(scene)), new_stack(), origin, d, rng.random((count, bounces, 2), np.float32), done)
    return done


@subroutine
def _touch_all(scene, stack, o, d, u, met, hits):
    for i in range(len(o)):
        origin = (o[i, 0], o[i, 1], o[i, 2])
        direction = (d[i, 0], d[i, 1], d[i, 2])
        hit = closest_hit(scene.bvh, stack, origin, direction, _FAR, None)
        hits[i] = hit.primitive != NO_PRIMITIVE
        met[i] = False
        if hits[i]:
            surface = surface_at(scene, origin, direction, hit)
            s, t = vec.basis(surface.geometric)
            local = square_to_cosine_hemisphere((u[i, 0], u[i, 1]))
            away = vec.to_world(s, t, surface.geometric, local)
            met[i] = any_hit(scene.bvh, stack, offset_ray_origin(surface, True, away), away, _FAR, None)


@entry
def _touch(scene, stack, o, d, u, met, hits):
    _touch_all(by_reference(scene), stack, o, d, u, met, hits)


def touch(scene: CompiledScene, o: np.ndarray, d: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Returns two (n,) bool arrays: whether rays hit, and whether cosine-distributed rays from the hit points hit again."""
    u = np.random.default_rng(seed).random((len(d), 2), np.float32)
    hits, met = np.zeros(len(d), bool), np.zeros(len(d), bool)
    o = many(o, len(d))
    _touch(Packed(as_rendered(scene)), new_stack(), o, np.ascontiguousarray(d, np.float32), u, met, hits)
    return hits, met
