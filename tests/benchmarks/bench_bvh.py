"""Benchmark of the BVH on one thread: building over a million triangles, tracing rays, and the cost of instances.

    python3 farm.py bench bvh                       # [terrain | instances]

Rates are per second of processor time, so that other work on the machine matters less. Primary rays start at one eye in raster
order, random rays join two random points of the bounding sphere, shadow rays are random rays that query any hit.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from renderer.bvh.build import build
from renderer.bvh.instances import Instances
from renderer.bvh.layout import Bvh
from renderer.bvh.traverse import NO_PRIMITIVE, any_hit, closest_hit, new_stack
from renderer.jit import entry
from renderer.scene.load import read

_RAYS = 500_000
_FAR = np.float32(np.inf)
_ONE = np.float32(1.0)


@entry
def _closest(bvh, stack, origin, direction):
    hits = 0
    for i in range(len(origin)):
        o = (origin[i, 0], origin[i, 1], origin[i, 2])
        d = (direction[i, 0], direction[i, 1], direction[i, 2])
        hits += closest_hit(bvh, stack, o, d, _FAR)[1] != NO_PRIMITIVE
    return hits


@entry
def _any(bvh, stack, origin, direction):
    hits = 0
    for i in range(len(origin)):
        o = (origin[i, 0], origin[i, 1], origin[i, 2])
        d = (direction[i, 0], direction[i, 1], direction[i, 2])
        hits += any_hit(bvh, stack, o, d, _ONE)
    return hits


def _terrain(n: int) -> tuple[Any, Any]:
    """Returns a height field of 2 (n - 1)**2 triangles as (positions, triangles)."""
    y, x = np.mgrid[0:n, 0:n] * (1000.0 / n)
    z = 40 * np.sin(x * 0.05) * np.cos(y * 0.07) + 5 * np.sin(x * 0.9) * np.sin(y * 0.8)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + n], -1)
    upper = np.stack([corner + 1, corner + n + 1, corner + n], -1)
    return np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32), np.concatenate([lower, upper]).astype(np.int32)


def _rays(position: Any) -> dict[str, tuple[Any, Any]]:
    """Returns primary and random rays, by these names: (origins, directions), each (n, 3) float32."""
    rng = np.random.default_rng(0)
    center = (position.min(0) + position.max(0)) / 2
    radius = np.linalg.norm(position.max(0) - position.min(0)) / 2
    side = int(_RAYS**0.5)
    y, x = np.mgrid[0:side, 0:side] / side - 0.5
    looking = np.stack([x, y, -np.ones_like(x)], -1).reshape(-1, 3).astype(np.float32)
    eye = np.broadcast_to((center + np.array([0, 0, 1.2 * radius])).astype(np.float32), looking.shape)
    points = rng.standard_normal((2, _RAYS, 3))
    points = center + radius * points / np.linalg.norm(points, axis=-1, keepdims=True)
    start, end = points.astype(np.float32)
    return {"primary": (np.ascontiguousarray(eye), looking), "random": (start, end - start)}


def _rate(work: Callable[[], Any], amount: int, rounds: int = 5) -> float:
    """Returns the highest rate of several rounds, in millions per second.

    amount: rays or triangles that one call of `work` processes.
    """
    best = np.inf
    for _ in range(rounds):
        begin = time.process_time()
        work()
        best = min(best, time.process_time() - begin)
    return amount / best / 1e6


def _trace(name: str, bvh: Bvh, position: Any) -> dict[str, float]:
    """Traces primary, random and shadow rays through the BVH, and returns the rates by these names, in millions per second.

    It also prints the rates. name: of the scene, for the printed lines.
    """
    rates = {}
    rays = _rays(position)
    stack = new_stack()
    for kind, kernel, (o, d) in (
        ("primary", _closest, rays["primary"]),
        ("random", _closest, rays["random"]),
        ("shadow", _any, rays["random"]),
    ):
        kernel(bvh, stack, o[:1], d[:1])  # compiles the kernel before timing starts
        rates[kind] = _rate(lambda k=kernel, o=o, d=d: k(bvh, stack, o, d), len(o))
        print(f"{name}, {kind} rays: {rates[kind]:.1f} M/s")
    return rates


def _bytes(bvh: Bvh) -> int:
    return sum(array.nbytes for array in bvh if isinstance(array, np.ndarray))


def _bunny() -> tuple[Any, Any]:
    """Returns (positions, triangles) of a mesh.

    The mesh is the first in the scene file $RAYFARM_BUNNY, or a terrain of 70,000 triangles if that is no file.
    """
    path = Path(os.environ.get("RAYFARM_BUNNY", ""))
    if not path.is_file():
        return _terrain(187)
    mesh = read(path.parent, path.name).meshes[0]
    return mesh.positions, mesh.triangles


def _places(position: Any, count: int) -> Any:
    """Returns `count` instance transforms (3, 4) on a square grid, each rotated about the vertical axis by a random angle."""
    side = int(np.ceil(count**0.5))
    size = float((position.max(0) - position.min(0)).max())
    places = np.zeros((count, 3, 4))
    for i, angle in enumerate(np.random.default_rng(1).uniform(0, 2 * np.pi, count)):
        c, s = np.cos(angle), np.sin(angle)
        places[i, :, :3] = ((c, 0, s), (0, 1, 0), (-s, 0, c))
        places[i, :, 3] = i % side * size, 0, i // side * size
    return places


def _instances() -> None:
    """Measures instancing, and prints two comparisons.

    First, a BVH of a thousand instances against a BVH of the mesh alone: memory and build time. Second, sixteen instances against
    sixteen copies of the mesh in world space: rays per second.
    """
    none = np.zeros((0, 4), np.float32)
    position, triangle = _bunny()
    first = np.array([0, len(triangle)])

    def timed(*arguments: Any) -> tuple[Bvh, float]:
        best, bvh = np.inf, build(*arguments)
        for _ in range(3):
            begin = time.process_time()
            bvh = build(*arguments)
            best = min(best, time.process_time() - begin)
        return bvh, best

    one, one_time = timed(position, triangle, none)
    shown = Instances(first, np.zeros(1000, int), _places(position, 1000))
    thousand, thousand_time = timed(position, triangle, none, shown)
    print(f"one mesh of {len(triangle)} triangles: {_bytes(one) / 1e6:.1f} MB, built in {one_time:.2f} s")
    print(
        f"a thousand of it: {_bytes(thousand) / _bytes(one):.3f} times the memory, {thousand_time / one_time:.2f} times the time"
    )
    places = _places(position, 16)
    copies = np.concatenate([position @ m[:, :3].T + m[:, 3] for m in places]).astype(np.float32)
    every = np.concatenate([triangle + i * len(position) for i in range(16)]).astype(np.int32)
    kept = build(position, triangle, none, Instances(first, np.zeros(16, int), places))
    copied = build(copies, every, none)
    slow = _trace("sixteen kept once", kept, copies)
    fast = _trace("sixteen copied", copied, copies)
    for kind, rate in slow.items():
        print(f"kept once / copied, {kind} rays: {rate / fast[kind]:.2f}")


def main() -> None:
    """Prints the rates of building, tracing and instances, or only those named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="?", choices=("terrain", "instances"), help="one of the two; both unless told")
    part = parser.parse_args().part
    if part != "instances":
        _terrains()
    if part != "terrain":
        _instances()


def _terrains() -> None:
    none = np.zeros((0, 4), np.float32)
    for n in (129, 708):
        position, triangle = _terrain(n)
        build(position[:3], triangle[:1] * 0, none)
        bvh = build(position, triangle, none)
        print(f"terrain of {len(triangle)} triangles: {len(bvh.node)} nodes, {len(triangle) / len(bvh.packet):.1f} a packet")
        print(f"build: {_rate(lambda p=position, t=triangle: build(p, t, none), len(triangle), 3):.2f} M triangles/s")
        _trace(f"terrain of {len(triangle)}", bvh, position)


if __name__ == "__main__":
    main()
