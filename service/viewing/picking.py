"""Picking: finds the surface under a pixel of a view by rendering one sample with all AOVs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from protocol.sums import unpack_sums
from protocol.view_parts import Part, ViewAnswer, ViewParts
from protocol.viewport import Picked
from renderer.film import DEPTH, NORMAL, POSITION, Sums, mean
from renderer.settings import Tile
from service.viewing.pending import PendingMessage
from service.viewing.pixel_direction import pixel_direction
from service.viewing.session import ViewSession

__all__ = ["pick_message", "record_pick"]

FILM_EXPONENT = 24


def pick_message(session: ViewSession, message: str, x: int, y: int) -> ViewParts:
    """Returns the message by which a worker renders one sample of pixel (x, y).

    message: the message's id. The sample has no depth of field, since a wide lens could hit any of several surfaces.
    """
    assert session.settings is not None
    view = replace(session.settings.view, aperture=0.0)
    settings = replace(session.settings, view=view, film_exponent=FILM_EXPONENT)
    return ViewParts(message, session.id, session.view, session.compiled, settings, [Part(0, Tile(x, y, 1, 1), 0, 1)], True)


def record_pick(out: PendingMessage, pick: tuple[int, int], answer: ViewAnswer) -> None:
    """Passes the result of a pick to the session: the pixel's direction, and depth, position and normal of the surface.

    Depth, position and normal are None if the ray misses. The direction is None while the view is restarted. out: the message
    that the worker has answered. pick: the pixel.
    """
    session, (x, y) = out.session, pick
    sums = unpack_sums(answer.sums, Tile(x, y, 1, 1))
    depth = float(mean(sums, FILM_EXPONENT, DEPTH)[0, 0])
    seen: dict[str, Any] = dict.fromkeys(("depth", "position", "normal"))
    if depth > 0.0:
        seen = {"depth": depth, "position": _vector(sums, POSITION), "normal": _vector(sums, NORMAL)}
    settings = session.settings
    direction = settings and pixel_direction(settings.view, settings.width, settings.height, x + 0.5, y + 0.5)
    session.picked.append(Picked(x, y, direction, **seen))
    out.pick = None
    session.wake()


def _vector(sums: Sums, plane: slice) -> list[float]:
    return [float(value) for value in mean(sums, FILM_EXPONENT, plane)[0, 0]]
