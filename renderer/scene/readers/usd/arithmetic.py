"""MaterialX nodes that calculate: on numbers as they say, on a texture as far as that is a factor and an addend."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.readers.usd.inputs import Input
from renderer.scene.readers.usd.textures import Four, Taken

__all__ = ["NODES", "calculated", "same_channels"]

F64 = npt.NDArray[np.float64]
Said = Callable[[str], Input]

_ONE_DEFAULT: Mapping[str, float] = {"multiply": 1.0, "divide": 1.0, "power": 1.0}
_PAIRS: Mapping[str, Callable[[F64, F64], F64]] = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "divide": lambda a, b: np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape), where=b != 0),
    "power": lambda a, b: np.power(np.maximum(a, 0), b),
    "min": np.minimum,
    "max": np.maximum,
}
NODES = (*_PAIRS, "mix", "invert", "remap", "range", "clamp")


def calculated(node: str, said: Said) -> Input | None:
    """What a node gives; None where that is no number, and no texture times a factor plus an addend. said: its inputs."""
    if node in _PAIRS:
        one, other = said("in1"), said("in2")
        if other.taken is None and other.value is None:
            other = Input(_ONE_DEFAULT.get(node, 0.0))
        if one.taken is None and one.value is None:
            one = Input(0.0)
        return _pair(node, one, other)
    if node == "mix":
        share = said("mix")
        back, front = (_or(said(name), 0.0) for name in ("bg", "fg"))
        return _mix(back, front, _or(share, 0.0))
    given = _or(said("in"), 0.0)
    if node == "invert":
        return _pair("subtract", _or(said("amount"), 1.0), given)
    if node == "clamp":
        low, high = (_or(said(name), default) for name, default in (("low", 0.0), ("high", 1.0)))
        if given.taken is not None:
            return given if (_values(low) <= 0).all() and (_values(high) >= 1).all() else None
        return _value(np.clip(_values(given), _values(low), _values(high)))
    if node == "range" and (np.any(_values(_or(said("gamma"), 1.0)) != 1) or said("doclamp").number(0.0)):
        return None
    ends = [_or(said(name), d) for name, d in (("inlow", 0.0), ("inhigh", 1.0), ("outlow", 0.0), ("outhigh", 1.0))]
    if any(each.taken is not None for each in ends):
        return None
    begin, end, least, most = (_values(each) for each in ends)
    span = end - begin
    factor = np.divide(most - least, span, out=np.zeros(np.broadcast(most - least, span).shape), where=span != 0)
    return _affine(given, factor, least - begin * factor)


def _or(given: Input, default: float) -> Input:
    return Input(default) if given.taken is None and given.value is None else given


def _values(given: Input) -> F64:
    return np.asarray(given.value, np.float64)


def _value(values: Any) -> Input:
    return Input(float(values) if np.ndim(values) == 0 else tuple(float(v) for v in values))


def _affine(given: Input, factor: F64, addend: F64) -> Input | None:
    """The input times a factor, plus an addend."""
    if given.taken is None:
        return _value(_values(given) * factor + addend)
    if given.taken.channel != "rgb" and (np.ptp(factor) > 1e-6 or np.ptp(addend) > 1e-6):
        return None  # of one channel three colours
    f, a = (np.broadcast_to(v[:4] if np.ndim(v) and np.size(v) >= 4 else _three(v), 4) for v in (factor, addend))
    scale, bias = np.array(given.taken.scale) * f, np.array(given.taken.bias) * f + a
    return Input(None, replace(given.taken, scale=_four(scale), bias=_four(bias)))


def _four(values: F64) -> Four:
    r, g, b, a = (float(v) for v in values)
    return r, g, b, a


def _three(values: F64) -> F64:
    """Of a number itself; of three, a fourth behind them."""
    return values if np.ndim(values) == 0 else np.append(values, [values[-1]] * (4 - len(values)))


def _pair(node: str, one: Input, other: Input) -> Input | None:
    if one.taken is None and other.taken is None:
        try:
            return _value(_PAIRS[node](_values(one), _values(other)))
        except ValueError:  # of different lengths, or no numbers
            return None
    if one.taken is not None and other.taken is not None:
        return None
    if one.taken is not None:
        value = _values(other)
        if node == "divide" and (value == 0).any():
            return None
        line = {"add": (1.0, value), "subtract": (1.0, -value), "multiply": (value, 0.0)}
        line["divide"] = (1 / np.where(value == 0, 1, value), 0.0)
        if node == "power" and (value == 1).all():
            return one
    else:
        value = _values(one)
        line = {"add": (1.0, value), "subtract": (-1.0, value), "multiply": (value, 0.0)}
    if node not in line:
        return None
    factor, addend = line[node]
    return _affine(one if one.taken is not None else other, np.asarray(factor), np.asarray(addend))


def _mix(back: Input, front: Input, share: Input) -> Input | None:
    if share.taken is not None:
        if back.taken is not None or front.taken is not None:
            return None
        return _affine(share, _values(front) - _values(back), _values(back))
    t = _values(share)
    if (t <= 0).all() or (t >= 1).all():
        return back if (t <= 0).all() else front
    if back.taken is not None and front.taken is not None:
        return None
    if front.taken is not None:
        return _affine(front, t, _values(back) * (1 - t))
    return _affine(back, 1 - t, _values(front) * t)


def same_channels(found: list[Input]) -> Taken | None:
    """The texture whose red, green and blue these are; None where they are not."""
    taken = [each.taken for each in found]
    if len(taken) < 3 or any(one is None or one.texture != taken[0].texture for one in taken if taken[0] is not None):
        return None
    kept = [one for one in taken if one is not None]
    if len(kept) != len(taken) or [one.channel for one in kept[:3]] != ["r", "g", "b"]:
        return None
    spans = [one.span(one.channel) for one in kept[:3]]
    scale, bias = ((*(span[k] for span in spans), (1.0, 0.0)[k]) for k in (0, 1))
    return Taken(kept[0].texture, "rgb", scale, bias)  # type: ignore[arg-type]
