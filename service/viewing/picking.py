"""What lies under a pixel of a view: one sample of it, with all planes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from renderer.film import DEPTH, NORMAL, POSITION, Sums, mean
from renderer.settings import Tile
from service.viewing.handed import Handed
from service.viewing.sight import sight
from service.viewing.watch import Watch
from worker.protocol.sums import unpack_sums
from worker.protocol.view_parts import Part, ViewAnswer, ViewParts

__all__ = ["answered", "picking"]

FILM_EXPONENT = 24


def picking(watch: Watch, message: str, x: int, y: int) -> ViewParts:
    """The message that asks for it, of a sharp picture: through a wide lens one sees more than one place."""
    assert watch.settings is not None
    view = replace(watch.settings.view, aperture=0.0)
    settings = replace(watch.settings, view=view, film_exponent=FILM_EXPONENT)
    return ViewParts(message, watch.id, watch.view, watch.compiled, settings, [Part(0, Tile(x, y, 1, 1), 0, 1)], True)


def answered(out: Handed, pick: tuple[int, int], answer: ViewAnswer) -> None:
    """Tell the page which way the pixel looks, and of what it sees the distance from the eye, the place and the normal.

    Those three are None where nothing is; the first is while the view is begun anew."""
    watch, (x, y) = out.watch, pick
    sums = unpack_sums(answer.sums, Tile(x, y, 1, 1))
    depth = float(mean(sums, FILM_EXPONENT, DEPTH)[0, 0])
    seen: dict[str, Any] = dict.fromkeys(("depth", "position", "normal"))
    if depth > 0.0:
        seen = {"depth": depth, "position": _vector(sums, POSITION), "normal": _vector(sums, NORMAL)}
    settings = watch.settings
    direction = settings and sight(settings.view, settings.width, settings.height, x + 0.5, y + 0.5)
    watch.picked.append({"x": x, "y": y, "direction": direction, **seen})
    out.pick = None
    watch.wake()


def _vector(sums: Sums, plane: slice) -> list[float]:
    return [float(value) for value in mean(sums, FILM_EXPONENT, plane)[0, 0]]
