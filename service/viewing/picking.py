"""What lies under a pixel of a view: one sample of it, of which all planes are asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from renderer.film import DEPTH, POSITION, mean
from renderer.settings import Tile
from service.viewing.watch import Watch
from worker.sums import unpack_sums
from worker.view_parts import Part, ViewAnswer, ViewParts

__all__ = ["picked", "picking"]

FILM_EXPONENT = 24


def picking(watch: Watch, message: str, x: int, y: int) -> ViewParts:
    """The message that asks for it, of a sharp picture: through a wide lens one sees more than one place."""
    assert watch.settings is not None
    view = replace(watch.settings.view, aperture=0.0)
    settings = replace(watch.settings, view=view, film_exponent=FILM_EXPONENT)
    return ViewParts(message, watch.id, watch.view, watch.compiled, settings, [Part(0, Tile(x, y, 1, 1), 0, 1)], True)


def picked(x: int, y: int, answer: ViewAnswer) -> dict[str, Any]:
    """The answer for the page: the distance from the eye, and the place in the world; None where nothing is."""
    sums = unpack_sums(answer.sums, Tile(x, y, 1, 1))
    depth = float(mean(sums, FILM_EXPONENT, DEPTH)[0, 0])
    position = [float(value) for value in mean(sums, FILM_EXPONENT, POSITION)[0, 0]]
    is_hit = depth > 0.0
    return {"x": x, "y": y, "depth": depth if is_hit else None, "position": position if is_hit else None}
