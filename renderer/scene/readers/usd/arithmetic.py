"""Evaluates arithmetic MaterialX nodes.

Constant inputs are computed at once. A linear function of one texture becomes a scale and a bias of that texture; other
functions of textures are baked into a new texture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.readers.usd.baking import baked, span_of
from renderer.scene.readers.usd.formulas import FORMULAS
from renderer.scene.readers.usd.inputs import Input
from renderer.scene.readers.usd.textures import Four, TextureInput
from renderer.scene.textures import TextureShelf

__all__ = ["calculated", "calculates", "combined"]

F64 = npt.NDArray[np.float64]
Formula = Callable[[list[F64]], F64]
_STEPS = np.linspace(0, 1, 6)  # sample positions of the linearity test, 0..1
_TOLERANCE = 1e-6


def calculates(kind: str) -> bool:
    """Returns True if a node is a supported arithmetic node. kind: its definition, such as `ND_multiply_color3`."""
    return _node(kind) in FORMULAS


def _node(kind: str) -> str:
    return kind[3:].split("_")[0]


def calculated(kind: str, shelf: TextureShelf, read_input: Callable[[str], Input]) -> Input | None:
    """Returns the output of a node; None if the node is not arithmetic or its textures have different UV mappings.

    kind: the node's definition, such as `ND_multiply_color3`; read_input: returns an input of the node by name.
    """
    if not calculates(kind):
        return None
    formula = FORMULAS[_node(kind)]
    given = [_or_default(read_input(name), default) for name, default in formula.inputs.items()]
    if _node(kind) == "multiply":
        picture, vertices = sorted(given, key=lambda each: each.taken is None)
        if picture.taken is not None and vertices.primvar is not None:
            return Input(None, picture.taken, vertices.primvar)
    textures = [at for at, each in enumerate(given) if each.taken is not None]
    values = [np.zeros(4) if each.taken is not None else _extend_to_four(each.value) for each in given]

    def evaluate(those: list[F64]) -> F64:
        known = dict(zip(textures, those, strict=True))
        return np.asarray(formula.of(*(known.get(at, values[at]) for at in range(len(given)))), np.float64)

    with np.errstate(all="ignore"):
        if not textures:
            count = max((np.size(each.value) for each in given), default=1)
            found = np.broadcast_to(evaluate([]), 4)
            return Input(float(found[0]) if count == 1 else tuple(float(v) for v in found[:count]))
        if len(textures) == 1 and formula.is_apart:
            line = _as_scale_and_bias(shelf, given[textures[0]], evaluate)
            if line is not None:
                return line
        taken = [each.taken for each in given if each.taken is not None]
        what = f"{kind} of {[(name, each.value) for name, each in zip(formula.inputs, given, strict=True)]}"
        made = baked(shelf, taken, what, evaluate, "color4" in kind or "vector4" in kind)
    return None if made is None else Input(None, made)


def combined(kind: str, shelf: TextureShelf, found: Sequence[Input]) -> Input | None:
    """Returns separate channels combined to a vector or colour; None if their textures have different UV mappings."""
    if not any(each.taken is not None for each in found):
        return Input(tuple(each.number(0.0) for each in found))
    same = _same_channels(found)
    if same is not None:
        return Input(None, same)
    taken = [replace(each.taken, channel="r") if each.taken.channel == "rgb" else each.taken for each in found if each.taken]

    def evaluate(those: list[F64]) -> F64:
        rest = iter(those)
        channels = [next(rest) if each.taken else np.full((1, 1, 1), each.number(0.0)) for each in found]
        channels += [np.full((1, 1, 1), float(k == 3)) for k in range(len(channels), 4)]
        return np.concatenate(np.broadcast_arrays(*channels), axis=-1)

    made = baked(shelf, taken, f"{kind} of {[each.value for each in found]}", evaluate, len(found) == 4)
    return None if made is None else Input(None, made)


def _or_default(given: Input, default: Any) -> Input:
    return Input(default) if given.taken is None and given.value is None else given


def _extend_to_four(value: Any) -> F64:
    """Returns a number as a 0-d array, or a vector extended to four numbers by repeating its last one."""
    if np.ndim(value) == 0:
        return np.asarray(float(value))
    numbers = [float(v) for v in value][:4]
    return np.array(numbers + [numbers[-1]] * (4 - len(numbers)))


def _as_scale_and_bias(shelf: TextureShelf, given: Input, formula: Formula) -> Input | None:
    """Returns a texture input to which a formula is applied by changing its scale and bias.

    Returns None if the formula is not linear over the values that the texture can have.
    """
    assert given.taken is not None
    low, high = span_of(shelf, given.taken)
    is_color = given.taken.channel == "rgb"
    scale, bias = map(np.array, (given.taken.scale, given.taken.bias) if is_color else given.taken.span(given.taken.channel))
    ends = scale * low + bias, scale * high + bias
    span = np.broadcast_to(ends[1] - ends[0], 4)
    if (np.abs(span) < _TOLERANCE).any():
        return None
    points = np.broadcast_to(ends[0], 4) + _STEPS[:, None] * span
    found = np.broadcast_to(formula([points]), points.shape)
    factor = (found[-1] - found[0]) / span
    addend = found[0] - factor * points[0]
    if not np.allclose(found, factor * points + addend, rtol=1e-6, atol=_TOLERANCE * float(np.abs(found).max())):
        return None
    if not is_color and (np.ptp(factor) > _TOLERANCE or np.ptp(addend) > _TOLERANCE):
        return None  # a scalar input with three different outputs
    return Input(
        None, replace(given.taken, scale=_tuple(given.taken.scale * factor), bias=_tuple(given.taken.bias * factor + addend))
    )


def _tuple(values: F64) -> Four:
    r, g, b, a = (float(v) for v in values)
    return r, g, b, a


def _same_channels(found: Sequence[Input]) -> TextureInput | None:
    """Returns the one texture input that equals separate red, green and blue inputs.

    Returns None unless the inputs are these three channels of the same texture, in this order.
    """
    taken = [each.taken for each in found]
    if len(taken) < 3 or any(one is None or one.texture != taken[0].texture for one in taken if taken[0] is not None):
        return None
    kept = [one for one in taken if one is not None]
    if len(kept) != len(taken) or [one.channel for one in kept[:3]] != ["r", "g", "b"]:
        return None
    spans = [one.span(one.channel) for one in kept[:3]]
    scale, bias = ((*(span[k] for span in spans), (1.0, 0.0)[k]) for k in (0, 1))
    return TextureInput(kept[0].texture, "rgb", scale, bias)  # type: ignore[arg-type]
