"""Row `rays`: closest and any hit on one thread compared with Embree; row `build`: the BVH on all cores.

embreex offers neither packets nor streams: its C loop calls rtcIntersect1 or rtcOccluded1 once per ray, as ours calls its own
traversal. Both sides read the rays from an array and write the hits to another. Time is processor time.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from renderer.bvh.build import build
from renderer.bvh.layout import Bvh
from renderer.bvh.traverse import NO_PRIMITIVE, new_stack
from tests.benchmarks.peers.asking import Peer
from tests.benchmarks.peers.measure import Line, Taken, race, ratio_line, taken
from tests.benchmarks.peers.meshes import displaced_sphere
from tests.benchmarks.peers.ray_kernels import trace_any, trace_closest
from tests.benchmarks.peers.sizes import Sizes
from tests.benchmarks.peers.surroundings import python_with_embree

__all__ = ["build_lines", "ray_lines"]

_FAR = np.float32(1e30)
_WHOLE = np.float32(1.0)
_ALIKE = 1e-3  # share of rays that may hit on one side only: those that graze an edge
_NO_SPHERES = np.zeros((0, 4), np.float32)
_BUILT = "large mesh"

Rays = tuple[np.ndarray, np.ndarray]


def ray_lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
    """Compares rays per second with Embree; yields ten lines, five for each of two meshes.

    The five are closest hit for camera, random and bounce rays, and any hit for random and bounce rays.
    """
    with Peer(python_with_embree(), "embree_peer") as embree:
        for name, triangles in (("small mesh", sizes.small_mesh), ("large mesh", sizes.large_mesh)):
            if not sizes.wants(name):
                continue
            mesh, path = _mesh(triangles, folder)
            bvh = build(mesh.positions, mesh.triangles, _NO_SPHERES)
            embree.ask("build", mesh=str(path))
            kinds = _rays(bvh, mesh.positions, mesh.triangles, sizes.rays)
            for kind, rays in kinds.items():
                np.savez(folder / f"{name}-{kind}.npz", origin=rays[0], direction=rays[1])
            for query, names in (("closest", ("camera", "random", "bounce")), ("any", ("random", "bounce"))):
                for kind in (kind for kind in names if sizes.wants(f"{name}, {query} hit, {kind}")):
                    file = str(folder / f"{name}-{kind}.npz")
                    to_a_point = query == "any" and kind == "random"  # like shadow rays
                    reach = _WHOLE if to_a_point else _FAR
                    yield _line(f"{name}, {query} hit, {kind}", sizes.rounds, bvh, embree, query, kinds[kind], file, reach)


def _line(name: str, rounds: int, bvh: Bvh, embree: Peer, query: str, rays: Rays, file: str, reach: np.float32) -> Line:
    origin, direction = rays
    stack, count = new_stack(), len(origin)
    met, distance = np.empty(count, np.int32), np.empty(count, np.float32)

    def ours(_: int = 0) -> Taken:
        if query == "closest":
            return taken(lambda: trace_closest(bvh, stack, origin, direction, reach, distance, met))
        return taken(lambda: trace_any(bvh, stack, origin, direction, reach, met))

    def ask() -> dict[str, Any]:
        what = "INTERSECT" if query == "closest" else "OCCLUDED"
        return embree.ask("trace", rays=file, query=what, reach=float(reach))

    def theirs(_: int) -> Taken:
        told = ask()
        return Taken(told["wall"], told["cpu"])

    ours()  # compiles, and touches both sides' memory, before timing starts
    hits = int((met >= 0).sum()), ask()["hits"]
    if abs(hits[0] - hits[1]) > _ALIKE * count:
        raise RuntimeError(f"{name}: of {count} rays {hits[0]} hit here and {hits[1]} in Embree; they do not do the same work")
    run = race(ours, theirs, rounds, clock="cpu")
    rates = [[count / seconds / 1e6 for seconds in side] for side in run.seconds]
    notes = {"hit": hits[0] / count, **embree.ask("about")}
    return ratio_line("rays", name, run.ratios, "M rays/s", *rates, **notes)


def build_lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
    """Compares the build times of our 8-wide BVH and of Embree's; yields two lines.

    Copying the mesh to Embree does not count.
    """
    if not sizes.wants(_BUILT):
        return
    mesh, path = _mesh(sizes.large_mesh, folder)
    with Peer(python_with_embree(), "embree_peer") as embree:
        build(mesh.positions[mesh.triangles[0]], np.array([[0, 1, 2]], np.int32), _NO_SPHERES)
        embree.ask("build", mesh=str(path))
        run = race(
            lambda _: taken(lambda: build(mesh.positions, mesh.triangles, _NO_SPHERES)),
            lambda _: Taken(**embree.ask("build", mesh=str(path))),
            sizes.rounds,
        )
        yield ratio_line("build", _BUILT, run.ratios, "s", *run.seconds, cpu_ratio=run.cpu_ratio, **embree.ask("about"))


def _mesh(triangles: int, folder: Path) -> tuple[Any, Path]:
    mesh = displaced_sphere(triangles)
    path = folder / f"mesh-{triangles}.npz"
    np.savez(path, position=mesh.positions, triangle=mesh.triangles)
    return mesh, path


def _rays(bvh: Bvh, position: np.ndarray, triangle: np.ndarray, count: int) -> dict[str, Rays]:
    """Returns `count` rays by kind: camera, random and bounce.

    camera: from one eye, in raster order. random: between two points of the bounding sphere. bounce: from the camera rays' hits,
    cosine-distributed about the face normal.
    """
    rng = np.random.default_rng(0)
    radius = float(np.linalg.norm(position, axis=1).max())
    side = int(count**0.5)
    y, x = np.mgrid[0:side, 0:side] / side - 0.5
    looking = np.stack([x, y, np.full_like(x, -1.1)], -1).reshape(-1, 3).astype(np.float32)
    eye = np.tile(np.array([0, 0, 2.8 * radius], np.float32), (len(looking), 1))
    ends = rng.standard_normal((2, count, 3))
    ends = (radius * ends / np.linalg.norm(ends, axis=-1, keepdims=True)).astype(np.float32)
    return {
        "camera": (eye, looking),
        "random": (ends[0], ends[1] - ends[0]),
        "bounce": _bounce_rays(bvh, position, triangle, eye, looking),
    }


def _bounce_rays(bvh: Bvh, position: np.ndarray, triangle: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> Rays:
    distance, primitive = np.empty(len(origin), np.float32), np.empty(len(origin), np.int32)
    trace_closest(bvh, new_stack(), origin, direction, _FAR, distance, primitive)
    met = primitive != NO_PRIMITIVE
    corner = position[triangle[primitive[met]]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= -np.sign(np.einsum("ij,ij->i", normal, direction[met]))[:, None]
    around = np.random.default_rng(1).standard_normal(normal.shape)
    way = normal + around / np.linalg.norm(around, axis=1, keepdims=True)
    point = origin[met] + distance[met, None] * direction[met] + 1e-4 * normal
    return np.ascontiguousarray(point, np.float32), np.ascontiguousarray(way, np.float32)
