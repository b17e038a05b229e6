"""Converts Blender's volume nodes to one homogeneous medium: absorption and scattering coefficients per metre, and anisotropy.

Source of the formulas: intern/cycles/kernel/svm/closure.h. Heterogeneous and emissive volumes cause a warning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..farm.protocol.sentences import Sentence
from .nodes import SocketInGroups, Source, constant_value, source_of

__all__ = ["Medium", "medium_of", "volume_of"]

Warn = Callable[[str], None]
MOST_NESTED = 32
NONE = 1e-9
# Unsupported phase functions and their names in warnings; they are replaced by Henyey-Greenstein.
OTHER_PHASES = {"RAYLEIGH": "Rayleigh", "MIE": "Mie", "DRAINE": "Draine", "FOURNIER_FORAND": "Fournier-Forand"}


@dataclass
class Medium:
    """A homogeneous medium. sigma_a, sigma_s: per metre. g: mean cosine of the scattering angle, -1 to 1."""

    sigma_a: list[float] = field(default_factory=lambda: [0.0] * 3)
    sigma_s: list[float] = field(default_factory=lambda: [0.0] * 3)
    g: float = 0.0

    def is_nothing(self) -> bool:
        """Returns True if the medium has no effect."""
        return max(*self.sigma_a, *self.sigma_s) <= NONE


def volume_of(tree: Any) -> Source | None:
    """Returns the Source connected to the volume output of a material's or a world's node tree."""
    for engine in ("CYCLES", "ALL", "EEVEE"):
        output = tree.get_output_node(engine)
        if output is not None:
            return source_of(SocketInGroups(output.inputs["Volume"]))[0] if output.inputs["Volume"].is_linked else None
    return None


def medium_of(source: Source | None, warn: Warn) -> Medium | None:
    """Returns the medium of a volume shader; None, with a warning, if it is unsupported."""
    return None if source is None else _read(source, warn, 0)


def _read(source: Source, warn: Warn, depth: int) -> Medium | None:
    kind = source.node.type
    read = {
        "VOLUME_SCATTER": _scatter,
        "VOLUME_ABSORPTION": _absorption,
        "PRINCIPLED_VOLUME": _principled,
        "VOLUME_COEFFICIENTS": _coefficients,
    }.get(kind)
    if read is not None:
        return read(source, warn)
    if depth < MOST_NESTED and kind == "ADD_SHADER":
        return _sum([_read_connected(source.input_at(i), warn, depth) for i in (0, 1)], [1.0, 1.0])
    if depth < MOST_NESTED and kind == "MIX_SHADER":
        share = constant_value(source.input_at(0))
        if isinstance(share, float):
            share = min(max(share, 0.0), 1.0)
            return _sum([_read_connected(source.input_at(i), warn, depth) for i in (1, 2)], [1 - share, share])
        warn(Sentence("cycles-volume-mix", "its volume is left out, since its mix factor varies"))
        return None
    warn(Sentence("cycles-volume-shader", "{shader} is left out of its volume", shader=source.node.bl_label or kind))
    return None


def _read_connected(socket: SocketInGroups, warn: Warn, depth: int) -> Medium | None:
    source, _ = source_of(socket)
    return None if source is None else _read(source, warn, depth + 1)


def _sum(parts: list[Medium | None], weights: list[float]) -> Medium | None:
    """Returns a medium with the weighted sum of the media's coefficients; g is the mean of theirs, weighted by scattering."""
    found = [(part, weight) for part, weight in zip(parts, weights, strict=True) if part is not None]
    if not found:
        return None
    made = Medium()
    for part, weight in found:
        made.sigma_a = [a + weight * b for a, b in zip(made.sigma_a, part.sigma_a, strict=True)]
        made.sigma_s = [a + weight * b for a, b in zip(made.sigma_s, part.sigma_s, strict=True)]
    whole = sum(sum(part.sigma_s) * weight for part, weight in found)
    if whole > 0:
        made.g = sum(part.g * sum(part.sigma_s) * weight for part, weight in found) / whole
    return made


def _number(source: Source, name: str, default: float, warn: Warn) -> float:
    at = source.input(name)
    if at is None:
        return default
    found = constant_value(at)
    if isinstance(found, list):
        return sum(found) / len(found)
    if isinstance(found, float):
        return found
    warn(
        Sentence(
            "cycles-volume-input-nodes",
            "the input {input} of its volume varies in Blender; its constant value is used",
            input=name,
        )
    )
    own = getattr(at.socket, "default_value", default)
    return float(own) if isinstance(own, int | float) else default


def _color(source: Source, name: str, default: list[float], warn: Warn) -> list[float]:
    at = source.input(name)
    if at is None:
        return default
    found = constant_value(at)
    if found is None:
        warn(
            Sentence(
                "cycles-volume-input-nodes",
                "the input {input} of its volume varies in Blender; its constant value is used",
                input=name,
            )
        )
        found = getattr(at.socket, "default_value", default)
    values = [float(found)] * 3 if isinstance(found, int | float) else [float(c) for c in found][:3]
    return [max(c, 0.0) for c in values]


def _density(source: Source, warn: Warn) -> float:
    return max(_number(source, "Density", 1.0, warn), 0.0)


def _direction(source: Source, warn: Warn) -> float:
    """Returns the mean cosine of the scattering angle; warns if the phase function is not supported."""
    phase = getattr(source.node, "phase", "HENYEY_GREENSTEIN")
    if phase in OTHER_PHASES:
        warn(
            Sentence(
                "cycles-volume-phase",
                "its volume has the Henyey-Greenstein phase function, not {phase}",
                phase=OTHER_PHASES[phase],
            )
        )
        if phase == "RAYLEIGH":
            return 0.0
        if phase != "DRAINE":
            return 0.9  # drops of water and fog scatter nearly all light forwards
    return min(max(_number(source, "Anisotropy", 0.0, warn), -0.999), 0.999)


def _scatter(source: Source, warn: Warn) -> Medium:
    density = _density(source, warn)
    return Medium(sigma_s=[c * density for c in _color(source, "Color", [0.8] * 3, warn)], g=_direction(source, warn))


def _absorption(source: Source, warn: Warn) -> Medium:
    density = _density(source, warn)
    return Medium(sigma_a=[max(1 - c, 0.0) * density for c in _color(source, "Color", [0.8] * 3, warn)])


def _coefficients(source: Source, warn: Warn) -> Medium:
    if max(_color(source, "Emission Coefficients", [0.0] * 3, warn)) > NONE:
        warn(Sentence("cycles-volume-emission", "the emission of its volume is left out"))
    scattered = _color(source, "Scatter Coefficients", [1.0] * 3, warn)
    return Medium(_color(source, "Absorption Coefficients", [1.0] * 3, warn), scattered, _direction(source, warn))


def _principled(source: Source, warn: Warn) -> Medium:
    if _number(source, "Emission Strength", 0.0, warn) > NONE or _number(source, "Blackbody Intensity", 0.0, warn) > NONE:
        warn(Sentence("cycles-volume-emission", "the emission of its volume is left out"))
    density = _density(source, warn)
    color = _color(source, "Color", [0.5] * 3, warn)
    kept = [c**0.5 for c in _color(source, "Absorption Color", [0.0] * 3, warn)]
    absorbed = [max(1 - c, 0.0) * max(1 - a, 0.0) * density for c, a in zip(color, kept, strict=True)]
    g = min(max(_number(source, "Anisotropy", 0.0, warn), -0.999), 0.999)
    return Medium(absorbed, [c * density for c in color], g)
