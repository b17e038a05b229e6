"""The part of a request that states how much to render (samples, noise limit, time limit) and in which order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from renderer.setting_declaration import Choices, Setting, SettingTexts, table
from renderer.settings import MAX_SPP

__all__ = ["DEFAULT_SIZE", "DEFAULT_SPP", "ORDERS", "SHOT", "WORK", "ShotWork", "Work", "most_samples"]

# Size and spp of a picture if neither its request nor its scene file sets any limit.
DEFAULT_SIZE = (960, 540)
DEFAULT_SPP = 64
NOISE_SPP = 16384  # the limit if only a noise level is requested


@dataclass(frozen=True)
class Work:
    """How much to render, and in which order; neither affects a sample's colour.

    Of several limits (samples, noise, time) the first that is reached ends the render.
    """

    spp: Annotated[
        int | None,
        Setting(1, MAX_SPP),
        SettingTexts(
            "Samples per pixel",
            f"Samples per pixel: {DEFAULT_SPP} by default, or as many as a noise level or a time limit takes.",
            group="basic",
            section="Size and quality",
            phrase="{} spp",
            usual=(1, 4096),
        ),
    ] = None
    noise: Annotated[
        float | None,
        Setting(1e-6, 10.0),
        SettingTexts(
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
        SettingTexts(
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
        SettingTexts(
            "Tile size",
            "By default chosen by the picture's size. Changes no sample, only where a noise level ends.",
            "px",
            section="Schedule",
        ),
    ] = None
    priority: Annotated[
        int, Setting(-100, 100, digest=False), SettingTexts("Priority", "Higher is sooner.", section="Schedule")
    ] = 0


WORK = table(Work)

ORDERS = Choices(
    {
        "in-turn": SettingTexts("In turn", "Each frame is finished before the next begins."),
        "every-nth": SettingTexts("Every n-th first", "Every n-th frame first, then those halfway between, until all are there."),
        "centre-out": SettingTexts("Centre out", "The middle of the shot first."),
        "breadth-first": SettingTexts("Breadth first", "All frames with 1 sample, then with 2, 4, 8 ..."),
        "noisiest-first": SettingTexts(
            "Noisiest first", "What there is to spend is spent where noise is greatest, so that the shot ends at equal noise."
        ),
    }
)


@dataclass(frozen=True)
class ShotWork:
    """The fields of a request for several frames besides `Work`: frame rate, turntable and the order of frames."""

    fps: Annotated[
        float | None,
        Setting(1e-3, 1e4),
        SettingTexts("Frames a second", "Frame n shows the time n / fps; by default the file's own, else 24.", section="Time"),
    ] = None
    turntable: Annotated[
        float | None,
        Setting(1e-3, 1e7),
        SettingTexts(
            "Turntable",
            "The camera circles what it looks at once in this many seconds.",
            "s",
            section="Time",
            phrase="around in {} s",
        ),
    ] = None
    order: Annotated[
        str | None,
        Setting(choices=ORDERS, digest=False),
        SettingTexts(
            "Order",
            "Which frame comes next; by default in turn, or breadth first if only a time limit ends the shot.",
            section="Time",
        ),
    ] = None
    every: Annotated[
        int, Setting(2, 1024, digest=False), SettingTexts("Every", "The n of the order every-nth.", section="Time")
    ] = 8


SHOT = table(ShotWork)


def most_samples(spp: int | None, noise: float | None, seconds: float | None, defaults: Mapping[str, Any]) -> int:
    """Returns the maximum spp of a request.

    spp, noise, seconds: the request's limits, each None if not set. defaults: the scene file's settings, used if all three are
    None.
    """
    if spp is not None:
        return spp
    if noise is not None:
        return NOISE_SPP
    return MAX_SPP if seconds is not None else int(defaults.get("spp") or DEFAULT_SPP)
