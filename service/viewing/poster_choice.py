"""Chooses posters: which pictures are good enough, and which replace the present poster of a scene."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from service.store.models import Scene
from service.viewing.view_request import HOME_PIXELS

__all__ = [
    "GROWTH",
    "MIN_DENOISED",
    "MIN_NOISY",
    "MIN_PIXELS",
    "SAMPLES",
    "Poster",
    "is_better",
    "is_outdated",
    "is_worth_rendering",
    "poster_of",
    "renderer_of",
]

MIN_DENOISED, MIN_NOISY = 2.0, 16.0  # samples per pixel from which a picture becomes a poster, denoised and not
GROWTH = 4.0  # ratio of samples from which a picture replaces a poster; a smaller one is hardly visible
NOISY_WORTH = 1 / 16  # worth of a sample of a picture that is not denoised, relative to one of a denoised picture
MIN_PIXELS = 960 * 540  # a poster with fewer is replaced by a larger one
SAMPLES = 16  # per pixel of a poster that is rendered without a page


@dataclass(frozen=True)
class Poster:
    """A picture that is a scene's poster or may become it.

    width, height: in pixels. samples: per pixel, on average. renderer: `renderer_of` the workers that rendered it. view:
    `view_request.view_hash` of what it shows. Both are "" for posters of releases that did not record them.
    """

    width: int
    height: int
    samples: float
    denoised: bool
    renderer: str = ""
    view: str = ""


def poster_of(scene: Scene) -> Poster | None:
    """Returns a scene's poster; None if it has none, or one that cannot be read."""
    found = (scene.info or {}).get("poster")
    if not isinstance(found, dict):
        return None
    try:
        return Poster(
            *(int(found["width"]), int(found["height"]), float(found["samples"]), bool(found["denoised"])),
            *(str(found.get(name, "")) for name in ("renderer", "view")),
        )
    except (KeyError, TypeError, ValueError):
        return None


def renderer_of(kind: str) -> str:
    """Returns the release and the hash of the renderer's sources in a kind of workers (renderer.jit.kind)."""
    return "-".join(kind.split("-")[:2])


def is_outdated(poster: Poster, view: str, renderers: Collection[str]) -> bool:
    """Returns True if a poster shows another view than the page now opens with, or was made by another renderer.

    view: `view_hash` of the scene's home view. renderers: of the ready workers; if there are none, that is not compared.
    """
    return poster.view != view or (bool(renderers) and poster.renderer not in renderers)


def is_better(made: Poster, present: Poster | None) -> bool:
    """Returns True if a picture replaces the present poster, which is not outdated; None: there is none."""
    if present is None:
        return True
    [pixels, before] = [each.width * each.height for each in (made, present)]
    [worth, worth_before] = [each.samples * (1.0 if each.denoised else NOISY_WORTH) for each in (made, present)]
    if before < MIN_PIXELS and pixels > 1.2 * before:
        return worth >= min(MIN_DENOISED, worth_before)
    return pixels >= min(0.8 * before, MIN_PIXELS) and worth >= GROWTH * worth_before


def is_worth_rendering(present: Poster | None) -> bool:
    """Returns True if a poster of SAMPLES samples and HOME_PIXELS pixels would replace the present one, which is not outdated.

    The new one is taken to be denoised if the present one is.
    """
    return is_better(Poster(HOME_PIXELS, 1, SAMPLES, present is None or present.denoised), present)
