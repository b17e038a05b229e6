"""How much of a picture is rendered, and when: what a request says beside the settings, and no sample depends on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from renderer.declared import Setting, Shown, table
from renderer.settings import MAX_SPP

__all__ = ["WORK", "Work"]


@dataclass(frozen=True)
class Work:
    """How much is rendered, and in which order: no sample's colour depends on it. Whichever end comes first, ends it."""

    spp: Annotated[
        int | None,
        Setting(1, MAX_SPP),
        Shown("Samples per pixel", "Samples per pixel.", "", "basic", "Size and quality", phrase="{} spp"),
    ] = None
    noise: Annotated[
        float | None,
        Setting(1e-6, 10.0),
        Shown(
            "At noise",
            "Each tile ends where its relative error is this small.",
            "fraction",
            section="Size and quality",
            phrase="noise {}",
        ),
    ] = None
    seconds: Annotated[
        float | None,
        Setting(1e-3, 1e7),
        Shown(
            "Time limit",
            "Wall-clock time after which it ends as it is.",
            "s",
            section="Size and quality",
            option="time-limit",
            phrase="{} s",
        ),
    ] = None
    tile_size: Annotated[
        int | None,
        Setting(8, 512),
        Shown(
            "Tile size",
            "By the picture's size unless told. Changes no sample; with a noise level, where it ends.",
            "px",
            section="Schedule",
        ),
    ] = None
    priority: Annotated[int, Setting(-100, 100, digest=False), Shown("Priority", "Higher is sooner.", section="Schedule")] = 0


WORK = table(Work)
