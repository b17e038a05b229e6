"""pbrt's hair as a glossy surface of its colour: fibres that light goes through are not followed.

Source of the colours: d'Eon et al., "An energy-conserving hair reflectance model", EGSR 2011 (pigments), and Chiang et al.,
"A practical and controllable hair and fur model for production path tracing", 2016, eq. 9 (absorption and colour) and eq. 7
(roughness along the fibre and the variance that it stands for).
"""

from __future__ import annotations

import math

import numpy as np

from renderer.scene.description import Material, Vec3
from renderer.scene.readers.numbers import clamped
from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.textures import Textures, Varying

__all__ = ["color_of", "deviation", "hair"]

_EUMELANIN, _PHEOMELANIN = np.array([0.419, 0.697, 1.37]), np.array([0.187, 0.4, 1.05])
_BROWN = 1.3  # of eumelanin, where nothing is said


def hair(source: Parameters, textures: Textures, notes: Notes) -> Material:
    """The material of a `hair`."""
    notes.add(source.place, "hair is rendered as a glossy surface in its colour: light does not go through its fibres")
    along = textures.one_number(source, "beta_m", 0.3)
    around = textures.one_number(source, "beta_n", 0.3)
    source.used.update(("alpha", "sigma_a", "color", "reflectance", "eumelanin", "pheomelanin"))
    color = _color(source, textures, around)
    r, g, b = (clamped(v, 0.0, 1.0) for v in color.value)
    return Material(
        kind="metallic_roughness",
        base_color=(r, g, b),
        base_color_texture=color.texture,
        ior=clamped(textures.one_number(source, "eta", 1.55), 1.0, 4.0),
        roughness=clamped(math.sqrt(deviation(along)), 0.0, 1.0),
    )


def deviation(beta: float) -> float:
    """The angle, in radians, by which fibres of this longitudinal roughness spread light: the root of Chiang's variance."""
    return 0.726 * beta + 0.812 * beta**2 + 3.7 * beta**20


def color_of(absorption: np.ndarray, beta: float) -> np.ndarray:
    """The colour that a head of hair has whose fibres, 2 wide, absorb so much; beta: the azimuthal roughness."""
    spread = 5.969 - 0.215 * beta + 2.532 * beta**2 - 10.73 * beta**3 + 5.574 * beta**4 + 0.245 * beta**5
    return np.asarray(np.exp(-np.sqrt(np.maximum(absorption, 0.0)) * spread))


def _color(source: Parameters, textures: Textures, beta: float) -> Varying:
    absorbed = textures.index(source, "sigma_a")
    if absorbed is not None:
        return Varying(_three(color_of(np.array(textures.colors.numbers(absorbed)), beta)))
    for name in ("color", "reflectance"):
        if source.get(name) is not None:
            return textures.color(source, name, (0.5,) * 3)
    said = [source.get(name) is not None for name in ("eumelanin", "pheomelanin")]
    brown, red = (textures.one_number(source, name, 0.0) for name in ("eumelanin", "pheomelanin"))
    if not any(said):
        brown = _BROWN
    return Varying(_three(color_of(max(brown, 0.0) * _EUMELANIN + max(red, 0.0) * _PHEOMELANIN, beta)))


def _three(values: np.ndarray) -> Vec3:
    r, g, b = (float(v) for v in values)
    return r, g, b
