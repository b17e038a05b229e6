"""Blend operations between texture layers, in linear light.

The operations are those of importers (Assimp's aiTextureOp) and of painting programs (W3C, "Compositing and Blending Level 1",
section 10.1). A weight interpolates between the value below and the result, so a layer of weight 0 has no effect.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device

__all__ = ["OPERATIONS", "blended"]

_NAMES = ("over", "multiply", "add", "subtract", "divide", "screen", "signed_add", "darken", "lighten", "difference")
OPERATIONS = {name: number for number, name in enumerate(_NAMES)}
MULTIPLY, ADD, SUBTRACT, DIVIDE, SCREEN, SIGNED_ADD, DARKEN, LIGHTEN, DIFFERENCE = range(1, len(_NAMES))

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_LEAST_DIVISOR = np.float32(1.0 / 255.0)  # one 8-bit step, avoids division by zero


@device
def _operate(operation, below, layer):
    if operation == MULTIPLY:
        return below * layer
    if operation == ADD:
        return below + layer
    if operation == SUBTRACT:
        return below - layer
    if operation == DIVIDE:
        return below / max(layer, _LEAST_DIVISOR)
    if operation == SCREEN:
        return below + layer - below * layer
    if operation == SIGNED_ADD:
        return below + layer - _HALF
    if operation == DARKEN:
        return min(below, layer)
    if operation == LIGHTEN:
        return max(below, layer)
    if operation == DIFFERENCE:
        return abs(below - layer)
    return layer  # over


@device
def blended(operation, below, layer, weight, most):
    """Returns one channel of a layer blended onto `below` by operation number `operation`, clamped to 0 ... `most`."""
    mixed = below + weight * (_operate(operation, below, layer) - below)
    return min(max(mixed, _ZERO), most)
