"""Parses the values of Mitsuba's files: numbers, colours, spectra and transforms."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.sentences import Sentence
from renderer.settings import Vec3

__all__ = ["Matrix", "Spectrum", "numbers", "planck", "rgb", "value"]

F64 = npt.NDArray[np.float64]
Matrix = F64
Step = tuple[str, Mapping[str, str]]

_PLANCK, _LIGHT, _BOLTZMANN = 6.62607015e-34, 2.99792458e8, 1.380649e-23  # CODATA 2018

# XYZ of CIE 1931 to linear Rec.709.
_TO_RGB = np.array([[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]])


class Spectrum:
    """A spectrum: values at wavelengths in nanometres."""

    def __init__(self, wavelengths: Sequence[float], values: Sequence[float]) -> None:
        if len(wavelengths) != len(values) or not len(values):
            raise ValueError(
                Sentence(
                    "mitsuba-spectrum-lengths-differ",
                    "has {values} values for {wavelengths} wavelengths; it needs as many of both",
                    values=len(values),
                    wavelengths=len(wavelengths),
                )
            )
        order = np.argsort(wavelengths)
        self.wavelengths, self.values = np.array(wavelengths, float)[order], np.array(values, float)[order]

    def rgb(self, is_light: bool) -> Vec3:
        """Returns the spectrum's colour in linear Rec.709, with negative channels set to 0.

        is_light: True for a radiance, which is scaled so that an equal-energy spectrum of value 1 has luminance 1; False for a
        reflectance in 0..1, which is scaled so that a constant spectrum is grey.
        """
        if not is_light and (self.values == self.values[0]).all():
            return (float(self.values[0]),) * 3
        at = np.arange(380.0, 781.0, 5.0)
        weights = _TO_RGB @ _color_matching(at)
        found = weights @ self.at(at) / (_color_matching(at)[1].sum() if is_light else weights.sum(axis=1))
        r, g, b = np.maximum(found, 0.0)
        return float(r), float(g), float(b)

    def at(self, wavelengths: F64) -> F64:
        """Returns the values (W,) at wavelengths (W,) in nanometres: interpolated linearly, and 0 outside the given ones."""
        return np.asarray(np.interp(wavelengths, self.wavelengths, self.values, left=0.0, right=0.0))

    @property
    def mean(self) -> float:
        """Mean over the given wavelengths."""
        return float(self.values.mean())

    @classmethod
    def constant(cls, value: float) -> Spectrum:
        """Returns a spectrum with the same value at all wavelengths.

        As a reflectance it is grey; as a light it is warmer than Rec.709's white.
        """
        return cls((300.0, 900.0), (value, value))


@functools.cache
def _cached_matching(key: bytes) -> F64:
    at = np.frombuffer(key)

    def bell(height: float, mean: float, low: float, high: float) -> F64:
        spread = np.where(at < mean, low, high)
        return np.asarray(height * np.exp(-0.5 * ((at - mean) * spread) ** 2))

    x = bell(0.362, 442.0, 0.0624, 0.0374) + bell(1.056, 599.8, 0.0264, 0.0323) + bell(-0.065, 501.1, 0.0490, 0.0382)
    y = bell(0.821, 568.8, 0.0213, 0.0247) + bell(0.286, 530.9, 0.0613, 0.0322)
    z = bell(1.217, 437.0, 0.0845, 0.0278) + bell(0.681, 459.0, 0.0385, 0.0725)
    return np.stack([x, y, z])


def _color_matching(wavelengths: F64) -> F64:
    """Returns (3, W) the CIE 1931 colour matching functions at wavelengths in nanometres.

    Source: Wyman, Sloan and Shirley, JCGT 2(2), 2013, multi-lobe fit.
    """
    return _cached_matching(wavelengths.tobytes())


def planck(kelvin: float, scale: float = 1.0) -> Spectrum:
    """Returns the radiance of a black body, in W / (m^2 sr nm), times `scale`.

    Raises ValueError if the temperature is out of range.
    """
    if not 1 <= kelvin <= 1e6:
        raise ValueError(
            Sentence(
                "mitsuba-temperature-out-of-range",
                "the temperature is {kelvin} K; it must be from 1 to 1000000 K",
                kelvin=f"{kelvin:g}",
            )
        )
    at = np.arange(360.0, 831.0, 5.0)
    metres = at * 1e-9
    power = 1e-9 * 2 * _PLANCK * _LIGHT**2 / (metres**5 * np.expm1(_PLANCK * _LIGHT / (_BOLTZMANN * metres * kelvin)))
    return Spectrum(list(at), list(scale * power))


def rgb(found: Any, is_light: bool = False) -> Vec3:
    """Returns a linear RGB colour from three numbers, one number for grey, or a spectrum. is_light: as for `Spectrum.rgb`."""
    if isinstance(found, Spectrum):
        return found.rgb(is_light)
    r, g, b = np.broadcast_to(np.asarray(found, float).reshape(-1), (3,))
    return float(r), float(g), float(b)


def value(tag: str, written: Mapping[str, str], steps: Sequence[Step], curve: Callable[[str], str]) -> Any:
    """Returns the value of an XML element.

    Raises ValueError, whose message continues a sentence about the element, if the value is malformed.

    tag: the element's tag; written: its attributes; steps: for a transform, its child elements; curve: function that returns the
    text of a spectrum's file.
    """
    text = written.get("value", "").strip()
    if tag in ("float", "integer"):
        return numbers(text, 1)[0]
    if tag == "boolean":
        if text.lower() not in ("true", "false"):
            raise ValueError(Sentence("mitsuba-boolean-invalid", "{value} is neither true nor false", value=repr(text[:40])))
        return text.lower() == "true"
    if tag == "string":
        return text
    if tag in ("point", "vector"):
        if text:
            return numbers(text, 3)
        return np.array([numbers(written.get(axis, "0"), 1)[0] for axis in "xyz"])
    if tag in ("rgb", "srgb"):
        return _color(text, tag == "srgb")
    if tag in ("spectrum", "blackbody"):
        return _spectrum(text, written, curve)
    if tag in ("transform", "animation"):
        return _transform(steps)
    raise ValueError(Sentence("mitsuba-value-type-unknown", "this type of value is unknown"))


def numbers(text: str, count: int | None = None) -> F64:
    """Returns the numbers in a text. count: their required number, or None.

    Raises ValueError, whose message continues a sentence about the element, if they are malformed.
    """
    parts = [part for part in re.split(r"[\s,]+", text.strip()) if part]
    try:
        found = np.array([float(part) for part in parts])
    except ValueError:
        raise ValueError(Sentence("mitsuba-numbers-malformed", "{text} is not a list of numbers", text=repr(text[:60]))) from None
    if (count is not None and len(found) != count) or not len(found) or not np.isfinite(found).all():
        if count == 1:
            raise ValueError(Sentence("number-not-finite", "{text} is not a finite number", text=repr(text[:60])))
        if count is None:
            raise ValueError(
                Sentence("mitsuba-numbers-not-finite", "{text} is not a list of finite numbers", text=repr(text[:60]))
            )
        raise ValueError(
            Sentence(
                "mitsuba-numbers-count-wrong",
                "{text} is not a list of {count} finite numbers",
                text=repr(text[:60]),
                count=count,
            )
        )
    return found


def _color(text: str, is_encoded: bool) -> F64:
    if text.startswith("#"):
        if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
            raise ValueError(
                Sentence("mitsuba-colour-malformed", "{text} is not a colour; write it as #rrggbb", text=repr(text[:20]))
            )
        found = np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    else:
        found = numbers(text)
        if len(found) not in (1, 3):
            raise ValueError(
                Sentence("mitsuba-colour-count-wrong", "{text} is not a colour; give one number or three", text=repr(text[:60]))
            )
    if is_encoded:
        from renderer.image.tonemap import decode_srgb

        found = np.asarray(decode_srgb(found))
    return np.array(np.broadcast_to(found, (3,)))


def _spectrum(text: str, written: Mapping[str, str], curve: Callable[[str], str]) -> Any:
    if written.get("filename"):
        rows = [
            numbers(line, 2) for line in curve(written["filename"]).splitlines() if line.strip() and line.strip()[0] not in "#"
        ]
        if not rows:
            raise ValueError(Sentence("mitsuba-spectrum-file-empty", "its file has no values"))
        return Spectrum([row[0] for row in rows], [row[1] for row in rows])
    if written.get("temperature"):
        kelvin, scale = numbers(written["temperature"].rstrip("kK"), 1), numbers(written.get("scale", "1"), 1)
        return planck(float(kelvin[0]), float(scale[0]))
    if ":" not in text:
        found = numbers(text)
        if len(found) not in (1, 3):
            raise ValueError(_malformed_spectrum(text))
        return np.array(np.broadcast_to(found, (3,)))
    pairs = [pair.split(":") for pair in re.split(r"[\s,]+(?=\S+:)|,", text) if pair.strip()]
    if any(len(pair) != 2 for pair in pairs):
        raise ValueError(_malformed_spectrum(text))
    found = np.array([[numbers(part, 1)[0] for part in pair] for pair in pairs])
    return Spectrum(list(found[:, 0]), list(found[:, 1]))


def _malformed_spectrum(text: str) -> str:
    return Sentence(
        "mitsuba-spectrum-malformed",
        "{text} is not a spectrum; give one number, three, or pairs such as 400:0.1, 500:0.2",
        text=repr(text[:60]),
    )


def _transform(steps: Sequence[Step]) -> Matrix:
    """Returns the (4, 4) product of transform steps, each applied after the previous ones."""
    found = np.eye(4)
    for tag, written in steps:
        found = _step(tag.lower(), written) @ found
    return found


def _step(tag: str, written: Mapping[str, str]) -> Matrix:
    if tag == "matrix":
        given = numbers(written.get("value", ""))
        if len(given) not in (9, 16):
            raise ValueError(
                Sentence("mitsuba-matrix-count-wrong", "the matrix has {count} numbers; it needs 16 or 9", count=len(given))
            )
        found = np.eye(4)
        size = 4 if len(given) == 16 else 3
        found[:size, :size] = given.reshape(size, size)
        return found
    if tag == "lookat":
        return _look_at(
            *(numbers(written.get(key, fallback), 3) for key, fallback in (("origin", ""), ("target", ""), ("up", "0 1 0")))
        )
    missing = 1.0 if tag == "scale" else 0.0
    if "value" in written:
        given = numbers(written["value"])
        vector = np.array(np.broadcast_to(given, (3,))) if len(given) in (1, 3) else given
        if len(vector) != 3:
            raise ValueError(
                Sentence(
                    "mitsuba-step-count-wrong", "{tag} has {count} numbers; it needs one or three", tag=tag, count=len(vector)
                )
            )
    else:
        vector = np.array([numbers(written[axis], 1)[0] if axis in written else missing for axis in "xyz"])
    found = np.eye(4)
    if tag == "translate":
        found[:3, 3] = vector
    elif tag == "scale":
        found[:3, :3] = np.diag(vector)
    elif tag == "rotate":
        length = np.linalg.norm(vector)
        if length == 0:
            raise ValueError(Sentence("mitsuba-rotation-axis-zero", "the axis of the rotation has length 0"))
        x, y, z = vector / length
        angle = np.radians(numbers(written.get("angle", "0"), 1)[0])
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        found[:3, :3] = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    else:
        raise ValueError(Sentence("mitsuba-step-unknown", "{tag} is not a known step of a transform", tag=tag[:20]))
    return found


def _look_at(origin: F64, target: F64, up: F64) -> Matrix:
    """Returns a camera's transform to world space. Mitsuba's camera looks along +Z, with +X to its left.

    Raises ValueError if the direction is zero or parallel to up.
    """
    forward = target - origin
    left = np.cross(up, forward)
    if np.linalg.norm(forward) == 0 or np.linalg.norm(left) == 0:
        raise ValueError(Sentence("mitsuba-lookat-degenerate", "lookat gives no view: its target is its origin or lies along up"))
    forward, left = forward / np.linalg.norm(forward), left / np.linalg.norm(left)
    found = np.eye(4)
    found[:3, 0], found[:3, 1], found[:3, 2], found[:3, 3] = left, np.cross(forward, left), forward, origin
    return found
