"""Reads IES profiles: luminous intensity by direction, in candela.

Source: ANSI/IES LM-63-19, and its predecessors LM-63-1986, -91, -95 and -02. Angles of type C photometry equal those of the
kind SPHERE in renderer/kernel/light/emission_map.py: the axis is the nadir, the plane C0 is to its right, C90 upwards. In types
A and B, (0, 0) is the axis, and positive angles go right and up. In type A the poles are above and below, and horizontal angles
are longitudes; in type B the poles are left and right, and vertical angles are longitudes.
"""

from __future__ import annotations

import math
import re
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import EmissionMap
from renderer.scene.emission_maps import flux_of
from renderer.sentences import Sentence

__all__ = ["Photometry", "read_ies"]

F64 = npt.NDArray[np.float64]
Goniometry = Literal["A", "B", "C"]

_TYPES: dict[float, Goniometry] = {1.0: "C", 2.0: "B", 3.0: "A"}
_MOST_VALUES = 4_000_000
_MOST_BYTES = 64 << 20
_MOST_TEXELS = 2_000_000
_MOST_NUMBER = 1e12
_MOST_CANDELA = 1e12
_HUNDREDTHS = 100  # angles are compared in hundredths of a degree
_FINEST = 0.25  # degrees between rows if the angles have no larger common step
_ANGLE_TOLERANCE = 0.011  # degrees
_LEAST_STEP = 1e-4  # degrees

_LAMP_GEOMETRY = Sentence("ies-lamp-geometry", "lamp geometry")
_TILT_ANGLES = Sentence("ies-tilt-angles", "tilt angles")
_TILT_ANGLE_COUNT = Sentence("ies-tilt-angle-count", "number of tilt angles")
_TILT_FACTORS = Sentence("ies-tilt-factors", "tilt factors")
_LAMPS = Sentence("ies-lamps", "lamps")
_VERTICAL_ANGLES = Sentence("ies-vertical-angles", "vertical angles")
_VERTICAL_COUNT = Sentence("ies-vertical-angle-count", "number of vertical angles")
_HORIZONTAL_ANGLES = Sentence("ies-horizontal-angles", "horizontal angles")
_HORIZONTAL_COUNT = Sentence("ies-horizontal-angle-count", "number of horizontal angles")
_PHOTOMETRIC_TYPE = Sentence("ies-photometric-type", "photometric type")
_SIZE = Sentence("ies-size", "size of the luminous opening")
_BALLAST = Sentence("ies-ballast", "ballast factors")
_CANDELA = Sentence("ies-candela", "candela values")


class Photometry(NamedTuple):
    """A parsed profile. Of its tilt data, only the factor for the upright position is used."""

    emission: EmissionMap  # candela
    lumens: float
    goniometry: Goniometry
    notes: list[str]


class _Web(NamedTuple):
    goniometry: Goniometry
    vertical: F64  # (v,) degrees, ascending
    horizontal: F64  # (h,) degrees, ascending
    candela: F64  # (h, v)


def read_ies(data: bytes, name: str) -> Photometry:
    """Parses an IES file. name: of the file, for errors. Raises SceneError if it is damaged or unsupported."""
    notes: list[str] = []
    web = _parsed(data, name, notes)
    emission = _map_of_type_c(web, name) if web.goniometry == "C" else _map_of_type_a_or_b(web, name)
    return Photometry(emission, float(flux_of(emission)[0]), web.goniometry, notes)


def _parsed(data: bytes, name: str, notes: list[str]) -> _Web:
    if len(data) > _MOST_BYTES:
        raise SceneError(
            Sentence(
                "ies-file-too-large",
                "{name} has {mib} MiB; an IES profile has a few kilobytes",
                name=name,
                mib=len(data) >> 20,
            )
        )
    text = data.decode("utf-8-sig", "replace")
    tilt = re.search(r"^[ \t]*TILT[ \t]*=[ \t]*([^\r\n]*)", text, re.MULTILINE | re.IGNORECASE)
    if tilt is None:
        raise SceneError(
            Sentence(
                "ies-tilt-line-missing",
                "{name} is not an IES profile: it has no line TILT=; export it again as IES LM-63",
                name=name,
            )
        )
    numbers = _Numbers(text[tilt.end() :], name)
    factor = 1.0
    kind = tilt.group(1).strip().upper()
    if kind == "INCLUDE":
        numbers.next_numbers(1, _LAMP_GEOMETRY)
        count = numbers.count(_TILT_ANGLES, _TILT_ANGLE_COUNT)
        angles, factors = numbers.next_numbers(count, _TILT_ANGLES), numbers.next_numbers(count, _TILT_FACTORS)
        factor = float(np.interp(0.0, angles, factors)) if count else 1.0
        if count and not np.allclose(factors, factor):
            notes.append(Sentence("ies-tilt-ignored", "{name}: its tilt is ignored; it emits as if upright", name=name))
    elif kind not in ("NONE", ""):
        notes.append(
            Sentence(
                "ies-tilt-file-ignored",
                "{name}: its tilt is in another file, {file}, and is left out",
                name=name,
                file=kind[:60],
            )
        )
    _, _, multiplier = numbers.next_numbers(3, _LAMPS)
    vertical, horizontal = numbers.count(_VERTICAL_ANGLES, _VERTICAL_COUNT), numbers.count(_HORIZONTAL_ANGLES, _HORIZONTAL_COUNT)
    goniometry = _TYPES.get(float(numbers.next_numbers(1, _PHOTOMETRIC_TYPE)[0]))
    if goniometry is None:
        raise SceneError(
            Sentence(
                "ies-photometric-type-unknown",
                "{name}: its photometric type is not 1 (C), 2 (B) or 3 (A); export it again",
                name=name,
            )
        )
    numbers.next_numbers(4, _SIZE)
    ballast, other, _ = numbers.next_numbers(3, _BALLAST)
    # This field is a factor only before the 2019 standard, in which it describes how the file was generated.
    factor *= multiplier * ballast * (1.0 if re.match(r"\s*IES:\s*LM-63-", text, re.IGNORECASE) else other)
    if vertical * horizontal > _MOST_VALUES:
        raise SceneError(
            Sentence(
                "ies-values-too-many",
                "{name} has {vertical} x {horizontal} values; at most {most} are read",
                name=name,
                vertical=vertical,
                horizontal=horizontal,
                most=_MOST_VALUES,
            )
        )
    found = numbers.next_numbers(vertical, _VERTICAL_ANGLES), numbers.next_numbers(horizontal, _HORIZONTAL_ANGLES)
    candela = numbers.next_numbers(vertical * horizontal, _CANDELA).reshape(horizontal, vertical) * factor
    for angles, what in zip(found, (_VERTICAL_ANGLES, _HORIZONTAL_ANGLES), strict=True):
        if len(angles) == 0 or not (np.diff(angles) > _LEAST_STEP).all() or not abs(angles).max() <= 360:
            raise SceneError(
                Sentence(
                    "ies-angles-not-ascending",
                    "{name}: its {angles} do not ascend within 360 degrees; export it again",
                    name=name,
                    angles=what,
                )
            )
    if not abs(candela).max() <= _MOST_CANDELA:
        raise SceneError(
            Sentence("ies-candela-out-of-range", "{name}: its candela values are beyond all bounds; export it again", name=name)
        )
    return _Web(goniometry, *found, np.maximum(candela, 0.0))


class _Numbers:
    """Reads the numbers of a text in sequence."""

    def __init__(self, text: str, name: str) -> None:
        self._words, self._at, self._name = text.replace(",", " ").split(), 0, name

    def next_numbers(self, count: int, what: str) -> F64:
        """Returns the next `count` numbers. what: their name, for errors. Raises SceneError if any is missing or invalid."""
        words = self._words[self._at : self._at + count]
        self._at += count
        if len(words) < count:
            raise SceneError(
                Sentence(
                    "ies-file-cut-off",
                    "{name} ends before its {values}; give the whole file",
                    name=self._name,
                    values=what,
                )
            )
        try:
            found = np.array([float(word) for word in words], np.float64)
            if not (abs(found) <= _MOST_NUMBER).all():
                raise SceneError(
                    Sentence(
                        "ies-values-out-of-range",
                        "{name}: its {values} have numbers beyond all bounds; export it again",
                        name=self._name,
                        values=what,
                    )
                )
            return found
        except ValueError:
            raise SceneError(
                Sentence(
                    "ies-values-not-numbers",
                    "{name}: its {values} are not numbers; export it again",
                    name=self._name,
                    values=what,
                )
            ) from None

    def count(self, what: str, how_many: str) -> int:
        """Returns the next number, which must be a count. what: the counted items; how_many: name of the count, for errors.

        Raises SceneError if it is missing or not a valid count.
        """
        number = float(self.next_numbers(1, how_many)[0])
        if not (0 <= number <= _MOST_VALUES and number == int(number)):
            raise SceneError(
                Sentence(
                    "ies-count-invalid",
                    "{name}: its number of {values} is {count}; export it again",
                    name=self._name,
                    values=what,
                    count=f"{number:g}",
                )
            )
        return int(number)


def _map_of_type_c(web: _Web, name: str) -> EmissionMap:
    """Resamples a type C profile to regular angles, with the largest steps whose multiples include all angles of the profile."""
    top, bottom = web.vertical[0], web.vertical[-1]
    if not 0 <= top < bottom <= 180:
        raise SceneError(
            Sentence(
                "ies-vertical-angles-wrong",
                "{name}: its vertical angles go from {top} to {bottom}; type C allows 0 to 180. Export it again",
                name=name,
                top=f"{top:g}",
                bottom=f"{bottom:g}",
            )
        )
    around, candela = _whole_circle(web, name)
    columns = 1 if len(around) == 1 else round(360 / _step(np.append(around, 360.0), 720))
    rows = round((bottom - top) / _step(web.vertical, _MOST_TEXELS // columns)) + 1
    theta = np.linspace(top, bottom, rows)
    phi = np.arange(columns) * 360.0 / columns
    of_rows = np.stack([np.interp(theta, web.vertical, of_plane) for of_plane in candela])
    values = np.stack([np.interp(phi, around, of_row, period=360.0) for of_row in of_rows.T])
    return _grey_map(values, (0.0, 2 * math.pi, math.radians(top), math.radians(bottom)))


def _whole_circle(web: _Web, name: str) -> tuple[F64, F64]:
    """Returns the horizontal angles and the candela of a type C profile, extended to the whole circle by its symmetry.

    The angles are (n,), 0 <= angle < 360; the candela (n, v), for v vertical angles.
    """
    angles, candela = web.horizontal, web.candela
    if len(angles) == 1:
        return np.zeros(1), candela
    first, last = angles[0], angles[-1]
    if abs(first) < _ANGLE_TOLERANCE and abs(last - 90) < _ANGLE_TOLERANCE:  # symmetric in all quadrants
        angles, candela = np.r_[angles, 180 - angles[-2::-1]], np.r_[candela, candela[-2::-1]]
        last = 180.0
    if abs(first) < _ANGLE_TOLERANCE and abs(last - 180) < _ANGLE_TOLERANCE:  # symmetric about the plane C0-C180
        angles, candela = np.r_[angles, 360 - angles[-2::-1]], np.r_[candela, candela[-2::-1]]
    elif abs(first - 90) < _ANGLE_TOLERANCE and abs(last - 270) < _ANGLE_TOLERANCE:  # symmetric about the plane C90-C270
        angles, candela = np.r_[angles, 540 - angles[-2:0:-1]], np.r_[candela, candela[-2:0:-1]]
    elif not (last - first <= 360 + _ANGLE_TOLERANCE and 360 - (last - first) <= 1.5 * np.diff(angles).max()):
        raise SceneError(
            Sentence(
                "ies-horizontal-angles-wrong",
                "{name}: its horizontal angles go from {first} to {last}; type C allows only 0, or 0 to "
                "90, 180 or 360. Export it again",
                name=name,
                first=f"{first:g}",
                last=f"{last:g}",
            )
        )
    if angles[-1] - angles[0] > 360 - _ANGLE_TOLERANCE:
        angles, candela = angles[:-1], candela[:-1]
    order = np.argsort(angles % 360, kind="stable")
    return np.asarray((angles % 360)[order]), candela[order]


def _step(angles: F64, max_steps: int) -> float:
    """Returns the largest step, in degrees, whose multiples include all angles.

    If that takes `max_steps` steps or more, returns the step of a regular division into fewer than `max_steps` steps.
    """
    hundredths = np.rint(np.diff(angles) * _HUNDREDTHS).astype(np.int64)
    step = int(np.gcd.reduce(hundredths)) / _HUNDREDTHS
    span = float(angles[-1] - angles[0])
    if (
        step > 0
        and span / step < max_steps
        and abs(np.cumsum(hundredths) / _HUNDREDTHS - (angles[1:] - angles[0])).max() < _ANGLE_TOLERANCE
    ):
        return step
    return span / max(1, min(max_steps - 1, round(span / _FINEST)))


def _map_of_type_a_or_b(web: _Web, name: str) -> EmissionMap:
    """Resamples the intensities of a type A or B profile to angles about the axis; angles that begin at 0 are mirrored."""
    angles = []
    for own, what in ((web.horizontal, _HORIZONTAL_ANGLES), (web.vertical, _VERTICAL_ANGLES)):
        if not -90 <= own[0] <= 0 <= own[-1] <= 90:
            raise SceneError(
                Sentence(
                    "ies-angles-out-of-range",
                    "{name}: its {angles} go from {first} to {last}; type {type} allows -90 to 90. Export it again",
                    name=name,
                    angles=what,
                    first=f"{own[0]:g}",
                    last=f"{own[-1]:g}",
                    type=web.goniometry,
                )
            )
        angles.append(own)
    step = max(min(float(np.diff(each).min(initial=1.0)) for each in angles), _FINEST)
    rows, columns = round(180 / step) + 1, round(360 / step)
    theta, phi = np.radians(np.linspace(0, 180, rows))[:, None], np.arange(columns) * 2 * math.pi / columns
    right, up = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
    forward = np.broadcast_to(np.cos(theta), right.shape)
    latitude, longitude = (up, right) if web.goniometry == "A" else (right, up)
    found = np.degrees(np.arcsin(np.clip(latitude, -1, 1))), np.degrees(np.arctan2(longitude, forward))
    across, above = found[::-1] if web.goniometry == "A" else found
    values = _bilinear(web, across, above)
    return _grey_map(values, (0.0, 2 * math.pi, 0.0, math.pi))


def _bilinear(web: _Web, across: F64, above: F64) -> F64:
    """Returns candela of a type A or B profile, interpolated bilinearly; 0 outside its angles.

    across, above: horizontal and vertical angles in degrees.
    """
    lit = np.ones(across.shape, bool)
    places = []
    for own, wanted in ((web.horizontal, across), (web.vertical, above)):
        wanted = np.abs(wanted) if own[0] == 0 else wanted
        lit &= (wanted >= own[0] - _ANGLE_TOLERANCE) & (wanted <= own[-1] + _ANGLE_TOLERANCE) if len(own) > 1 else True
        place = np.interp(wanted, own, np.arange(len(own)))
        low = np.minimum(place.astype(int), max(len(own) - 2, 0))
        places.append((low, np.minimum(low + 1, len(own) - 1), place - low))
    (x0, x1, s), (y0, y1, t) = places
    table = web.candela
    left, right = table[x0, y0] * (1 - t) + table[x0, y1] * t, table[x1, y0] * (1 - t) + table[x1, y1] * t
    return np.asarray(np.where(lit, left * (1 - s) + right * s, 0.0))


def _grey_map(values: F64, edges: tuple[float, float, float, float]) -> EmissionMap:
    return EmissionMap("sphere", np.repeat(values[..., None], 3, axis=2).astype(np.float32), edges, at_edges=True)
