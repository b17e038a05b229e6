"""Chooses the world-space point that is the origin of a compiled scene's coordinates.

Float32 has 24 bits. Coordinates of a map projection or of the geocentric system (1e5 ... 6e6) leave too few of them for the shape
of a house. A scene that is far from the world's origin relative to its size is compiled relative to its own centre, with
differences computed in float64. All other scenes keep the world's origin, and so the same bits of their coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Instance, Light, SceneDescription, Sphere, Volume
from renderer.scene.frame_reuse import ShotCache
from renderer.settings import RenderSettings, Vec3, View

__all__ = [
    "fixed_point_origin",
    "in_exact_type",
    "origin_of",
    "relative_to_origin",
    "settings_relative_to_origin",
    "split_offset",
]

F64 = npt.NDArray[np.float64]

_MAX_RELATIVE_DISTANCE = 16.0  # relative to a scene's size: beyond, a float32 coordinate is wrong by up to 1e-6 of the size
_STRAYS_FAR = 4096.0  # the same, for the size without outliers (10th to 90th percentile)
_SAMPLES = 4096
_WORLD = np.zeros(3)
_MOST_FIXED = 2.0**62


def in_exact_type(points: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Returns points (N, 3) in float32, or in float64 if they are far from the origin relative to their size."""
    if points.dtype == np.float32 or not _origin(points).any():
        return points.astype(np.float32, copy=False)
    return points.astype(np.float64, copy=False)


def split_offset(points: npt.NDArray[Any]) -> tuple[F32, F64]:
    """Splits points (N, 3) into float32 points and an offset (3,), which is zero for points that are float32 already."""
    if points.dtype == np.float32:
        return points, _WORLD
    offset = _origin(points)
    return (points - offset).astype(np.float32), offset


def origin_of(description: SceneDescription, shot_cache: ShotCache | None = None) -> F64:
    """Returns the origin (3,) of the compiled scene: the static geometry's centre if far away relative to its size, else zero.

    Only scenes in which everything moves have different origins in different frames. shot_cache: cache of the shot.
    """
    shot_cache = shot_cache or ShotCache()

    def of_still() -> F64 | None:
        points = _samples(description, False)
        return _origin(points) if len(points) else None

    found = shot_cache.get_or_make("origin", object, of_still, description.still)
    if found is None:
        found = _origin(_samples(description, True))
    return found


def _origin(points: F64) -> F64:
    """Returns the centre of the points if it is far from zero relative to their size, else zero.

    Tests all points first, then only those between the 10th and the 90th percentile, so that outliers do not matter.
    """
    finite = np.isfinite(points).all(axis=1)
    points = points if finite.all() else points[finite]
    with np.errstate(invalid="ignore", over="ignore"):
        found = _centre(points, _MAX_RELATIVE_DISTANCE)
        if found.any() or not len(points):
            return found
        some = points[:: max(1, len(points) // _SAMPLES)]
        return _centre(np.percentile(some, (10.0, 90.0), axis=0), _STRAYS_FAR)


def _centre(points: F64, limit: float) -> F64:
    """Returns the centre of the points' bounding box if it is more than `limit` box sizes from the origin, else zero.

    It is rounded to about 1/256 of the box size.
    """
    if not len(points):
        return _WORLD
    low, high = points.min(axis=0), points.max(axis=0)
    centre, size = 0.5 * (low + high), float((high - low).max())
    if not (np.isfinite(size) and np.isfinite(centre).all()) or not 0.0 < limit * size < np.abs(centre).max():
        return _WORLD
    step = 2.0 ** (np.floor(np.log2(size)) - 8.0)
    return np.rint(centre / step) * step


def _samples(description: SceneDescription, moving: bool) -> F64:
    """Returns points (N, 3) sampled at equal steps over the triangles of all instances, and the box corners of spheres.

    moving: True for the moving instances and spheres, False for the static ones.
    """
    meshes = description.meshes
    shown = [i for i in description.instances if (i.moves or meshes[i.mesh].deforms) == moving and len(meshes[i.mesh].triangles)]
    ends = np.cumsum([len(meshes[i.mesh].triangles) for i in shown])
    count = int(ends[-1]) if shown else 0
    wanted = np.arange(0, count, max(1, -(-count // _SAMPLES)))
    places = np.searchsorted(ends, wanted, "right")
    # Also samples instances of few triangles, such as a ground of two, since they determine the scene's size.
    firsts = np.arange(0, len(shown), max(1, -(-len(shown) // _SAMPLES)))
    points = [_corners(description, shown[n], np.zeros(1, np.int64)) for n in firsts.tolist()]
    for n in np.unique(places).tolist():
        first = int(ends[n]) - len(meshes[shown[n].mesh].triangles)
        points.append(_corners(description, shown[n], wanted[places == n] - first))
    balls = [s for s in description.spheres if s.moves == moving]
    box = np.array([(s.center, (s.radius,) * 3) for s in balls[:: max(1, len(balls) // _SAMPLES)]], np.float64).reshape(-1, 2, 3)
    return np.concatenate([np.zeros((0, 3)), *points, box[:, 0] - box[:, 1], box[:, 0] + box[:, 1]])


def _corners(description: SceneDescription, instance: Instance, triangles: npt.NDArray[np.int64]) -> F64:
    mesh, place = description.meshes[instance.mesh], np.asarray(instance.transform, np.float64)
    points = mesh.positions[mesh.triangles[triangles].reshape(-1)].astype(np.float64)
    found: F64 = points[:, :1] * place[:3, 0] + points[:, 1:2] * place[:3, 1] + points[:, 2:] * place[:3, 2] + place[:3, 3]
    return found


def relative_to_origin(description: SceneDescription, origin: F64, shot_cache: ShotCache | None = None) -> SceneDescription:
    """Returns the description relative to another origin: instances, spheres, lights, and meshes in float32.

    Cameras are unchanged. shot_cache: cache of the shot.
    """
    far = [n for n, mesh in enumerate(description.meshes) if mesh.positions.dtype != np.float32]
    if not origin.any() and not far:
        return description
    meshes, offsets = list(description.meshes), {}
    points = (shot_cache or ShotCache()).get_or_make(
        "points", lambda: [meshes[n].positions for n in far], lambda: [split_offset(meshes[n].positions) for n in far]
    )
    for n, (position, offset) in zip(far, points, strict=True):
        keys = tuple(((each - offset).astype(np.float32), normals) for each, normals in meshes[n].keys)
        meshes[n], offsets[n] = replace(meshes[n], positions=position, keys=keys), offset
    return replace(
        description,
        meshes=meshes,
        instances=[_instance(each, origin, offsets.get(each.mesh, _WORLD)) for each in description.instances],
        spheres=[_sphere(each, origin) for each in description.spheres],
        lights=[_light(each, origin) for each in description.lights],
        volumes={name: _volume(each, origin) for name, each in description.volumes.items()},
        subject=None if description.subject is None else description.subject - origin,
    )


def _instance(instance: Instance, origin: F64, offset: F64) -> Instance:
    keys = tuple(_moved_transform(each, origin, offset) for each in instance.keys)
    return replace(instance, transform=_moved_transform(instance.transform, origin, offset), keys=keys)


def _moved_transform(transform: F64, origin: F64, offset: F64) -> F64:
    found = np.array(transform, np.float64)
    found[:3, 3] += found[:3, 0] * offset[0] + found[:3, 1] * offset[1] + found[:3, 2] * offset[2] - origin
    return found


def _sphere(sphere: Sphere, origin: F64) -> Sphere:
    keys = tuple((_moved_point(center, origin), radius) for center, radius in sphere.keys)
    return replace(sphere, center=_moved_point(sphere.center, origin), keys=keys)


def _volume(volume: Volume, origin: F64) -> Volume:
    place = np.array(volume.to_world, np.float64)
    place[:3, 3] -= origin
    return replace(volume, to_world=place)


def _light(light: Light, origin: F64) -> Light:
    return replace(light, position=_moved_point(light.position, origin), keys=tuple(_light(each, origin) for each in light.keys))


def _moved_point(point: Sequence[float], origin: F64) -> Vec3:
    x, y, z = (float(p) - float(o) for p, o in zip(point, origin, strict=True))
    return x, y, z


def settings_relative_to_origin(settings: RenderSettings, origin: F64) -> RenderSettings:
    """Returns the settings with their views relative to the compiled scene's origin."""
    if not origin.any():
        return settings
    view, *views = (_view(each, origin) for each in (settings.view, *settings.views))
    return replace(settings, view=view, views=tuple(views))


def fixed_point_origin(origin: F64, film_exponent: int) -> tuple[int, int, int]:
    """Returns the origin as integers in units of 2^-film_exponent, the film's fixed point."""
    if not origin.any():
        return 0, 0, 0
    x, y, z = (int(v) for v in np.rint(np.clip(origin * 2.0**film_exponent, -_MOST_FIXED, _MOST_FIXED)))
    return x, y, z


def _view(view: View, origin: F64) -> View:
    return replace(view, eye=_moved_point(view.eye, origin), target=_moved_point(view.target, origin))
