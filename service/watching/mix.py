"""Reads the query parameter `mix`: gains of a job's light groups."""

from __future__ import annotations

import math
from collections.abc import Sequence

from renderer.film import Gain
from renderer.sentences import Sentence
from service.errors import Invalid

__all__ = ["MAX_GAIN", "gains_of_mix"]

MAX_GAIN = 65536.0  # 16 stops


def gains_of_mix(text: str, groups: Sequence[str]) -> tuple[Gain, ...]:
    """Returns the gains of red, green and blue of each light group, for film.mixed; empty for an empty text.

    text: NAME:GAIN or NAME:RED/GREEN/BLUE, separated by commas; a group that is left out has the gain 1. groups: the job's, as
    RenderSettings.group_names. Raises Invalid for unknown groups and for gains outside of 0 ... MAX_GAIN.
    """
    if not text.strip():
        return ()
    if not groups:
        raise Invalid(
            Sentence(
                "mix-without-light-groups", "mix: the picture has no light groups; name some in light_groups when it is rendered."
            )
        )
    gains: dict[str, Gain] = dict.fromkeys(groups, (1.0, 1.0, 1.0))
    for part in text.split(","):
        name, _, value = (piece.strip() for piece in part.partition(":"))
        if name not in gains:
            raise Invalid(
                Sentence(
                    "mix-group-unknown",
                    "mix: {name} is not a light group of the picture; it has {known}.",
                    name=repr(name[:60]),
                    known=[*groups],
                )
            )
        gains[name] = _gain(value, name)
    return tuple(gains.values())


def _gain(text: str, name: str) -> Gain:
    try:
        values = [float(value) for value in text.split("/")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(math.isfinite(value) and 0 <= value <= MAX_GAIN for value in values):
        raise Invalid(
            Sentence(
                "mix-gain-invalid",
                "mix: {value} is not a gain for {name}; give a number from 0 to {most}, or three as red/green/blue.",
                value=repr(text[:60]),
                name=name,
                most=int(MAX_GAIN),
            )
        )
    red, green, blue = values * 3 if len(values) == 1 else values
    return red, green, blue
