"""Tabulates the emission maps of punctual lights for renderer/kernel/light/emission_map.py."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.kernel.light.emission_map import SCREEN, SPHERE, WINDOW
from renderer.scene.description import F32, I32, EmissionMap, Light, Vec3
from renderer.sentences import Sentence

__all__ = ["NO_EMISSION", "EmissionTables", "emission_frames", "flux_of", "maps_of", "tabulate_emission"]

F64 = npt.NDArray[np.float64]

_KINDS = {"sphere": SPHERE, "window": WINDOW, "screen": SCREEN}
_MOST_TEXELS = 1 << 28  # of all maps together: 3 GiB
_AROUND = 1e9  # columns: beyond any angle
_SLACK = 1e-3  # rows, by which float32 may miss a pole
_MIN_GRID_SIDE = 64  # least side of the grid over which projected images are integrated
_NO_EDGE = 1e-9


class EmissionTables(NamedTuple):
    """The emission-map tables of CompiledScene, and the flux of each map, by which lights are chosen."""

    map: I32  # (E, 4)
    window: F32  # (E, 8)
    texel: F32  # (O, 3)
    flux: F64  # (E, 3): of the intensity 1
    reach: F64  # (E,) radians from the axis, beyond which it is dark


NO_EMISSION = EmissionTables(
    np.zeros((0, 4), np.int32), np.zeros((0, 8), np.float32), np.zeros((0, 3), np.float32), np.zeros((0, 3)), np.zeros(0)
)


def maps_of(lights: Sequence[Light]) -> list[EmissionMap]:
    """Returns the distinct emission maps of the lights, in order of first use.

    Maps are compared by identity: lights with the same map must refer to the same object.
    """
    return list({id(light.emission): light.emission for light in lights if light.emission is not None}.values())


def tabulate_emission(maps: Sequence[EmissionMap]) -> EmissionTables:
    """Concatenates the emission maps into the tables of a compiled scene. Raises SceneError if the tables are too large."""
    if not maps:
        return NO_EMISSION
    sizes = [each.values.shape[0] * each.values.shape[1] for each in maps]
    if sum(sizes) > _MOST_TEXELS:
        raise SceneError(
            Sentence(
                "light-pictures-too-large",
                "The pictures and profiles of the scene's lights are too large together; make them smaller",
            )
        )
    first = np.cumsum([0, *sizes])
    rows = [(start, *each.values.shape[1::-1], _KINDS[each.kind]) for start, each in zip(first, maps, strict=False)]
    return EmissionTables(
        np.array(rows, np.int32),
        np.array([_window(each) for each in maps], np.float32),
        np.ascontiguousarray(np.concatenate([each.values.reshape(-1, 3) for each in maps]), np.float32),
        np.array([flux_of(each) for each in maps]),
        np.array([_max_angle(each) for each in maps]),
    )


def emission_frames(lights: Sequence[Light], maps: Sequence[EmissionMap]) -> F32:
    """Returns a row for each light, (n, 4): the vector to the right of its axis (3), and the index of its map in `maps`, or -1.

    Returns no rows if there are no maps.
    """
    if not maps:
        return np.zeros((0, 4), np.float32)
    number = {id(each): k for k, each in enumerate(maps)}
    rows = [(*_right_vector(light.direction, light.up), number.get(id(light.emission), -1)) for light in lights]
    return np.array(rows, np.float32).reshape(-1, 4)


def flux_of(emission: EmissionMap) -> F64:
    """Returns the integral of a map over all directions, (3,): the flux of a light of intensity 1 with this map."""
    values = emission.values.astype(np.float64)
    if emission.kind == "sphere":
        return np.asarray(2 * math.pi * _row_weights(emission) @ values.mean(axis=1))
    left, right, top, bottom = emission.edges
    if emission.kind == "screen":
        return np.asarray(values.mean(axis=(0, 1)) * abs((right - left) * (bottom - top)))
    height, width = (max(1, -(-_MIN_GRID_SIDE // n)) for n in values.shape[:2])
    fine = np.repeat(np.repeat(values, height, axis=0), width, axis=1)
    y, x = (_middles(start, end, n) for start, end, n in ((top, bottom, fine.shape[0]), (left, right, fine.shape[1])))
    weight = (1 + x * x + (y * y)[:, None]) ** -1.5
    return np.asarray((fine * weight[..., None]).mean(axis=(0, 1)) * abs((right - left) * (bottom - top)))


def _window(emission: EmissionMap) -> tuple[float, ...]:
    """Returns the linear mapping from the map's coordinates to columns and rows, and the range of valid columns and rows.

    Eight numbers: scale and offset of the column, scale and offset of the row, first and last column, first and last row.
    """
    left, right, top, bottom = emission.edges
    height, width = emission.values.shape[:2]
    if emission.at_edges:
        scale, lines = width / (right - left), max(height - 1, 1) / (bottom - top)
        return scale, -left * scale, lines, -top * lines, -_AROUND, _AROUND, -_SLACK, height - 1 + _SLACK
    scale, lines = width / (right - left), height / (bottom - top)
    first, last = (-_AROUND, _AROUND) if emission.kind == "sphere" else (-0.5, width - 0.5)
    slack = _SLACK if emission.kind == "sphere" else 0.0
    return scale, -left * scale - 0.5, lines, -top * lines - 0.5, first, last, -0.5 - slack, height - 0.5 + slack


def _row_weights(emission: EmissionMap) -> F64:
    """Returns each row's weight in the integral of the map, (h,).

    A weight is the integral of the row's linear interpolation kernel times the sine of the polar angle.
    """
    top, bottom = emission.edges[2:]
    rows = emission.values.shape[0]
    if rows == 1:
        return np.array([math.cos(top) - math.cos(bottom)])
    step = (bottom - top) / (rows - 1 if emission.at_edges else rows)
    at = top + step * (np.arange(rows) + (0.0 if emission.at_edges else 0.5))
    before = -np.cos(at) + (np.sin(at) - np.sin(at - step)) / step  # integral of the kernel's rising part
    after = np.cos(at) - (np.sin(at + step) - np.sin(at)) / step
    before[0] = math.cos(top) - math.cos(at[0])  # 0 if the first row is at the edge
    after[-1] = math.cos(at[-1]) - math.cos(bottom)
    return np.asarray(before + after)


def _max_angle(emission: EmissionMap) -> float:
    left, right, top, bottom = emission.edges
    if emission.kind != "sphere":
        return math.atan(math.hypot(max(abs(left), abs(right)), max(abs(top), abs(bottom))))
    lit = np.flatnonzero(emission.values.any(axis=(1, 2)))
    rows = emission.values.shape[0]
    return min(bottom, top + (bottom - top) * (float(lit.max(initial=0)) + 1.5) / max(rows - 1, 1))


def _middles(start: float, end: float, count: int) -> F64:
    return start + (end - start) * (np.arange(count) + 0.5) / count


def _right_vector(direction: Vec3, up: Vec3) -> F64:
    """Returns the unit vector (3,) to the right of an observer who looks along `direction`, with `up` upwards."""
    forward = np.array(direction, np.float64)
    forward = forward / max(float(np.linalg.norm(forward)), 1e-300)
    for above in (np.array(up, np.float64), np.array((0.0, 0.0, -1.0)), np.array((0.0, 1.0, 0.0))):
        across = np.cross(forward, above)
        length = float(np.linalg.norm(across))
        if length > _NO_EDGE * max(float(np.linalg.norm(above)), 1e-300):
            return np.asarray(across / length)
    return np.array((1.0, 0.0, 0.0))
