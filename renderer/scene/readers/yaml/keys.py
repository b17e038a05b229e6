"""Keyframes of a scene file: evaluates its data at a moment, so that no other module handles time.

Any value may be replaced by `{keys: [[seconds, value], ...], curve: linear}`. Values may be structures of equal form, such as
a transform's operations; each number in them is interpolated separately.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.animation import Curve, smooth
from renderer.scene.readers.replaced_values import Changed
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.values import color
from renderer.sentences import Sentence

__all__ = ["CURVES", "AnimatedPaths", "Keys", "find_keys"]

CURVES = ("linear", "step", "smooth")  # or the four numbers of a cubic Bezier
MAX_KEYS = 100_000
_UNKEYED_FIELDS = ("name", "fps", "settings", "notes")
_NAMING = ("file", "image", "picture", "profile")
_COLOR = re.compile(r"#[0-9a-fA-F]{6}")

Track = Callable[[float], Any]  # value by time in seconds
Maker = Callable[[npt.NDArray[np.float64]], Curve]  # curve through rows of values, one per key


class AnimatedPaths(NamedTuple):
    """The paths of a scene file's animated values.

    below: for each path that leads to an animated value, the fields or indices there that are animated completely or in part.
    """

    paths: set[Path]
    below: dict[Path, set[str | int]]

    def animated_fields(self, path: Path) -> set[str | int]:
        """Returns the fields of the value at a path that are animated, completely or in part."""
        return self.below.get(path, set())

    def is_animated(self, path: Path) -> bool:
        """Returns True if the value at a path, or a value that contains it, is animated as a whole."""
        return any(path[:k] in self.paths for k in range(1, len(path) + 1))


class Keys(NamedTuple):
    """The animated values of a scene file, and the range of their keys in seconds."""

    tracks: dict[Path, Track]
    start: float
    end: float
    patterns: list[Path]  # file names with a frame number, such as smoke.####.obj

    @property
    def is_animated(self) -> bool:
        """True if any value is animated."""
        return bool(self.tracks or self.patterns)

    def animated_paths(self) -> AnimatedPaths:
        """Returns the paths of all animated values."""
        paths = {*self.tracks, *self.patterns}
        below: dict[Path, set[str | int]] = {}
        for path in paths:
            for k, step in enumerate(path):
                below.setdefault(path[:k], set()).add(step)
        return AnimatedPaths(paths, below)

    def data_at(self, data: dict[str, Any], time: float, name_of: Callable[[str], str]) -> dict[str, Any]:
        """Returns the scene file's data at a time in seconds, with all keyframes and file name patterns replaced by values.

        name_of: returns the name of a pattern's file at that time, such as smoke.0012.obj for smoke.####.obj.
        """
        changed = Changed(data)
        for path, track in self.tracks.items():
            changed.set(path, track(time))
        for path in self.patterns:
            changed.set(path, name_of(_value_at(data, path)))
        return changed.root


def find_keys(document: Yaml) -> Keys:
    """Returns all keyframes of a file. Raises SceneError, with the line, for invalid keyframes."""
    tracks: dict[Path, Track] = {}
    ends: list[float] = []
    for path, source in _find_keys(document.data, ()):
        if path[0] in _UNKEYED_FIELDS:
            raise document.error(path, Sentence("keys-not-allowed", "has keys, but {path} cannot be animated", path=path[0]))
        times = _times(source["keys"], document, (*path, "keys"))
        make = _interpolation(source.get("curve", "linear"), times, document, (*path, "curve"))
        values = [value for _, value in source["keys"]]
        if source.get("curve") == "step":
            tracks[path] = _step_track(times, values)
        else:
            tracks[path] = _track(values, make, document, path)
        ends += [float(times[0]), float(times[-1])]
    return Keys(tracks, min(ends, default=0.0), max(ends, default=0.0), _patterns(document.data, ()))


def _find_keys(value: Any, path: Path) -> list[tuple[Path, dict[str, Any]]]:
    if isinstance(value, dict) and isinstance(value.get("keys"), list) and value.keys() <= {"keys", "curve"} and path:
        return [(path, value)]
    children = value.items() if isinstance(value, dict) else enumerate(value)
    return [found for key, child in children if isinstance(child, dict | list) for found in _find_keys(child, (*path, key))]


def _value_at(data: Any, path: Path) -> Any:
    """Returns the value at a path in nested dicts and lists."""
    for key in path:
        data = data[key]
    return data


def _patterns(value: Any, path: Path) -> list[Path]:
    if isinstance(value, str):
        return [path] if path[-1] in _NAMING and "#" in value else []
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [found for key, child in children if isinstance(child, dict | list | str) for found in _patterns(child, (*path, key))]


def _times(keys: list[Any], document: Yaml, path: Path) -> npt.NDArray[np.float64]:
    if not 1 <= len(keys) <= MAX_KEYS:
        raise document.error(
            path, Sentence("keys-count-wrong", "has {count} keys; it needs from 1 to {most}", count=len(keys), most=MAX_KEYS)
        )
    for i, key in enumerate(keys):
        if not isinstance(key, list) or len(key) != 2 or not _is_number(key[0]) or abs(key[0]) > 1e9:
            raise document.error((*path, i), Sentence("key-malformed", "is not a key; write [seconds, value]"))
        if i and key[0] <= keys[i - 1][0]:
            raise document.error((*path, i), Sentence("keys-not-ascending", "is not later than the key before it"))
    return np.array([key[0] for key in keys], np.float64)


def _interpolation(curve: Any, times: npt.NDArray[np.float64], document: Yaml, path: Path) -> Maker:
    if curve == "smooth":
        return lambda values: smooth(times, values)
    if curve in ("linear", "step"):
        return lambda values: Curve(times, values)
    if isinstance(curve, list) and len(curve) == 4 and all(map(_is_number, curve)) and 0 <= curve[0] <= 1 and 0 <= curve[2] <= 1:
        x1, y1, x2, y2 = (float(number) for number in curve)
        return lambda values: Curve(times, values, easing=(x1, y1, x2, y2))
    raise document.error(
        path,
        Sentence(
            "key-curve-unknown",
            "is none of {curves}, nor the [x1, y1, x2, y2] of a cubic Bezier with x from 0 to 1",
            curves=[*CURVES],
        ),
    )


def _step_track(times: npt.NDArray[np.float64], values: list[Any]) -> Track:
    which = Curve(times, np.arange(len(values), dtype=np.float64)[:, None], is_step=True)
    return lambda time: values[int(which.values_at(time)[0])]


def _track(values: list[Any], make: Maker, document: Yaml, path: Path) -> Track:
    """Returns a function of time that interpolates between keyed values of equal form.

    These are numbers, vectors, colours, or dicts and lists of these. Values that cannot be interpolated, such as names, must all
    be equal; otherwise SceneError is raised.
    """
    first = values[0]
    if all(value == first and type(value) is type(first) for value in values):
        return lambda time: first
    if path[-1] == "matrix":
        raise document.error(
            path,
            Sentence(
                "keys-matrix-not-interpolable",
                "rotates too far between keys to interpolate matrices; animate translate, rotate and scale instead",
            ),
        )
    if all(map(_is_number, values)):
        curve = make(np.array(values, np.float64)[:, None])
        return lambda time: curve.values_at(time)[0]
    rows = _vectors(values)
    if rows is not None:
        curve = make(np.array(rows, np.float64))
        return curve.values_at
    if all(isinstance(value, dict) and value.keys() == first.keys() for value in values):
        parts = {key: _track([value[key] for value in values], make, document, (*path, key)) for key in first}
        return lambda time: {key: part(time) for key, part in parts.items()}
    if all(isinstance(value, list) and len(value) == len(first) for value in values):
        places = [_track([v[i] for v in values], make, document, (*path, i)) for i in range(len(first))]
        return lambda time: [place(time) for place in places]
    raise document.error(
        path,
        Sentence(
            "keys-forms-differ",
            "has keys of different forms, which cannot be interpolated; use `curve: step` to jump between them",
        ),
    )


def _vectors(values: list[Any]) -> list[list[float]] | None:
    """Returns the values as vectors of equal length, with single numbers repeated; None if they are not numeric."""
    rows = [list(color(v)) if isinstance(v, str) and _COLOR.fullmatch(v) else v for v in values]
    widths = {len(row) for row in rows if isinstance(row, list)}
    if len(widths) != 1 or not all(_is_number(row) or (isinstance(row, list) and all(map(_is_number, row))) for row in rows):
        return None
    (width,) = widths
    return [row if isinstance(row, list) else [float(row)] * width for row in rows] if width else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
