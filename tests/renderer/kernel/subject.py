"""Evaluates and samples a material under test for many directions; the material is described and compiled as in a scene."""

from __future__ import annotations

import numpy as np

from renderer.jit import entry, subroutine
from renderer.kernel.material.material import LAYER_SLOTS, eval_material, fetch_material, sample_material
from renderer.kernel.surface.surface import NO_LIGHT, Surface
from renderer.reference import Packed, by_reference
from renderer.scene.description import Material
from tests.renderer.builders import as_rendered, scene, square


@subroutine
def _sample_all(compiled, surface, layers, wo, u, wi, weight, pdf):
    frame = ((np.float32(1), np.float32(0), np.float32(0)), (np.float32(0), np.float32(1), np.float32(0)), surface.shading)
    material = fetch_material(compiled, surface, frame, layers, None)
    for i in range(len(u)):
        w = (wo[i, 0], wo[i, 1], wo[i, 2])
        d, f, p, scale = sample_material(material, w, u[i, 0], (u[i, 1], u[i, 2]))
        for k in range(3):
            wi[i, k] = d[k]
            weight[i, k] = f[k]
        pdf[i, 0] = p
        pdf[i, 1] = scale


@entry
def _sample(compiled, surface, layers, wo, u, wi, weight, pdf):
    _sample_all(by_reference(compiled), surface, layers, wo, u, wi, weight, pdf)


@subroutine
def _eval_all(compiled, surface, layers, wo, wi, f, pdf):
    frame = ((np.float32(1), np.float32(0), np.float32(0)), (np.float32(0), np.float32(1), np.float32(0)), surface.shading)
    material = fetch_material(compiled, surface, frame, layers, None)
    for i in range(len(wi)):
        value, pdf[i] = eval_material(material, (wo[i, 0], wo[i, 1], wo[i, 2]), (wi[i, 0], wi[i, 1], wi[i, 2]))
        for k in range(3):
            f[i, k] = value[k]


@entry
def _eval(compiled, surface, layers, wo, wi, f, pdf):
    _eval_all(by_reference(compiled), surface, layers, wo, wi, f, pdf)


def many(vector, n):
    """Returns (n, 3) float32, broadcast from (3,) if need be; writable, since read-only arrays would compile another kernel."""
    return np.array(np.broadcast_to(vector, (n, 3)), np.float32, order="C")


def facing_up(**fields) -> Surface:
    """Returns a surface of material 0 at the origin, with the field types of real paths, so that compiled kernels are reused."""
    zero, one = np.float32(0), np.float32(1)
    up, nothing = (zero, zero, one), (zero, zero, zero)
    known = {
        "point": nothing, "error": zero, "geometric": up, "shading": up, "uv": (zero, zero), "front": True,
        "material": np.uint32(0), "light": NO_LIGHT, "object": np.uint32(0), "uv1": (zero, zero),
        "color": (one, one, one, one), "tangent": (one, zero, zero, one), "smooth": False, "lift": nothing,
    }  # fmt: skip
    return Surface(**{**known, **fields})


class Subject:
    """A material under test, seen from its front or back.

    Directions are in the local frame, whose z axis points to the viewer's side.
    """

    def __init__(self, material: Material, front: bool = True):
        self.material = material
        self.compiled = as_rendered(scene([material], (square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0),), environment=1.0))
        self._surface = facing_up(front=front)
        self._layers = np.zeros(LAYER_SLOTS, np.float32)

    def sample(self, wo, n=200_000, seed=0):
        """Returns n samples (wi, weight, pdf, scale) for directions wo (3,) or (n, 3).

        scale: eta^2 for refracted samples, by which radiance changes between media; 1 for others.
        """
        u = np.random.default_rng(seed).random((n, 3), np.float32)
        wi, weight, pdf = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty((n, 2), np.float32)
        _sample(Packed(self.compiled), self._surface, self._layers, many(wo, n), u, wi, weight, pdf)
        return wi, weight, pdf[:, 0], pdf[:, 1]

    def eval(self, wo, wi):
        """Returns (f |cos|, pdf) of n pairs of directions wo (3,) or (n, 3) and wi (n, 3)."""
        n = len(wi)
        f, pdf = np.empty((n, 3), np.float32), np.empty(n, np.float32)
        _eval(Packed(self.compiled), self._surface, self._layers, many(wo, n), np.ascontiguousarray(wi, np.float32), f, pdf)
        return f, pdf


def tilted(degrees, turn=0.7):
    """Returns a unit vector at `degrees` from z, with azimuth `turn`."""
    a = np.radians(degrees)
    return np.array((np.sin(a) * np.cos(turn), np.sin(a) * np.sin(turn), np.cos(a)))


def hemisphere(n, seed):
    """Returns (n, 3) uniform directions on the hemisphere, at least 0.02 above the horizon."""
    z, turn = np.random.default_rng(seed).random((2, n))
    z = 0.02 + 0.98 * z
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(2 * np.pi * turn), r * np.sin(2 * np.pi * turn), z], 1).astype(np.float32)
