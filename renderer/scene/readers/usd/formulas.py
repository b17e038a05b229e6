"""Arithmetic MaterialX nodes: the inputs of each with their default values, and its function.

Source: the specification of MaterialX 1.39, "Standard Nodes".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["FORMULAS", "Formula"]

F64 = npt.NDArray[np.float64]
_LUMA = (0.2722287, 0.6740818, 0.0536895)


class Formula(NamedTuple):
    """An arithmetic MaterialX node: its inputs with their default values, and the function `of` that it computes.

    The function takes one array per input, in order; the last axis of each array has one or four numbers.
    """

    inputs: Mapping[str, float | tuple[float, ...]]
    of: Callable[..., F64]
    is_apart: bool = True  # whether channels are independent


def _safe_quotient(a: F64, b: F64) -> F64:
    a, b = np.broadcast_arrays(a, b)
    return np.divide(a, b, out=np.zeros(a.shape), where=b != 0)


def _power(a: F64, b: F64) -> F64:
    return np.asarray(np.power(np.maximum(a, 0), np.minimum(b, 1e3)))


def _remap(x: F64, begin: F64, end: F64, low: F64, high: F64) -> F64:
    return low + (high - low) * _safe_quotient(x - begin, end - begin)


def _range(x: F64, begin: F64, end: F64, gamma: F64, low: F64, high: F64, clamps: F64) -> F64:
    share = _safe_quotient(x - begin, end - begin)
    bent = np.where(gamma == 1, share, np.sign(share) * _power(np.abs(share), _safe_quotient(np.ones(1), gamma)))
    found = low + (high - low) * bent
    return np.where(clamps > 0, np.clip(found, np.minimum(low, high), np.maximum(low, high)), found)


def _smooth(x: F64, low: F64, high: F64) -> F64:
    t = np.clip(_safe_quotient(x - low, high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def _luminance(x: F64, weights: F64) -> F64:
    return np.asarray((x * weights)[..., :3].sum(axis=-1, keepdims=True) + 0 * x)


def _saturated(x: F64, amount: F64, weights: F64) -> F64:
    grey = _luminance(x, weights)
    return np.asarray(grey + amount * (x - grey))


def _overlay(b: F64, f: F64) -> F64:
    return np.asarray(np.where(b < 0.5, 2 * f * b, 1 - 2 * (1 - f) * (1 - b)))


def _blend_formula(blend: Callable[[F64, F64], F64]) -> Formula:
    """Returns the formula of a blend mode: `mix * blend(bg, fg) + (1 - mix) * bg`."""
    return Formula({"bg": 0.0, "fg": 0.0, "mix": 1.0}, lambda b, f, share: share * blend(b, f) + (1 - share) * b)


def _select_formula(test: Callable[[F64, F64], npt.NDArray[np.bool_]], value1: float) -> Formula:
    inputs = {"value1": value1, "value2": 0.0, "in1": 0.0, "in2": 0.0}
    return Formula(inputs, lambda a, b, one, other: np.asarray(np.where(test(a, b), one, other), np.float64))


_SPAN = {"inlow": 0.0, "inhigh": 1.0}
_OUT = {"outlow": 0.0, "outhigh": 1.0}
FORMULAS: Mapping[str, Formula] = {
    "add": Formula({"in1": 0.0, "in2": 0.0}, np.add),
    "subtract": Formula({"in1": 0.0, "in2": 0.0}, np.subtract),
    "multiply": Formula({"in1": 0.0, "in2": 1.0}, np.multiply),
    "divide": Formula({"in1": 0.0, "in2": 1.0}, _safe_quotient),
    "modulo": Formula({"in1": 0.0, "in2": 1.0}, lambda a, b: a - b * np.floor(_safe_quotient(a, b))),
    "power": Formula({"in1": 0.0, "in2": 1.0}, _power),
    "safepower": Formula({"in1": 0.0, "in2": 1.0}, lambda a, b: np.sign(a) * _power(np.abs(a), b)),
    "min": Formula({"in1": 0.0, "in2": 0.0}, np.minimum),
    "max": Formula({"in1": 0.0, "in2": 0.0}, np.maximum),
    "absval": Formula({"in": 0.0}, np.abs),
    "sign": Formula({"in": 0.0}, np.sign),
    "floor": Formula({"in": 0.0}, np.floor),
    "ceil": Formula({"in": 0.0}, np.ceil),
    "round": Formula({"in": 0.0}, lambda x: np.floor(x + 0.5)),
    "sqrt": Formula({"in": 0.0}, lambda x: np.sqrt(np.maximum(x, 0))),
    "invert": Formula({"in": 0.0, "amount": 1.0}, lambda x, amount: amount - x),
    "clamp": Formula({"in": 0.0, "low": 0.0, "high": 1.0}, lambda x, low, high: np.minimum(np.maximum(x, low), high)),
    "remap": Formula({"in": 0.0, **_SPAN, **_OUT}, _remap),
    "range": Formula({"in": 0.0, **_SPAN, "gamma": 1.0, **_OUT, "doclamp": 0.0}, _range),
    "smoothstep": Formula({"in": 0.0, "low": 0.0, "high": 1.0}, _smooth),
    "contrast": Formula({"in": 0.0, "amount": 1.0, "pivot": 0.5}, lambda x, amount, pivot: (x - pivot) * amount + pivot),
    "luminance": Formula({"in": 0.0, "lumacoeffs": _LUMA}, _luminance, False),
    "saturate": Formula({"in": 0.0, "amount": 1.0, "lumacoeffs": _LUMA}, _saturated, False),
    "mix": Formula({"bg": 0.0, "fg": 0.0, "mix": 0.0}, lambda b, f, share: share * f + (1 - share) * b),
    "inside": Formula({"in": 0.0, "mask": 1.0}, np.multiply),
    "outside": Formula({"in": 0.0, "mask": 0.0}, lambda x, mask: x * (1 - mask)),
    "plus": _blend_formula(np.add),
    "minus": _blend_formula(np.subtract),
    "difference": _blend_formula(lambda b, f: np.abs(b - f)),
    "screen": _blend_formula(lambda b, f: 1 - (1 - f) * (1 - b)),
    "overlay": _blend_formula(_overlay),
    "ifgreater": _select_formula(np.greater, 1.0),
    "ifgreatereq": _select_formula(np.greater_equal, 1.0),
    "ifequal": _select_formula(np.equal, 0.0),
}
