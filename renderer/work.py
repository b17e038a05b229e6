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
            f"More samples, less noise. {DEFAULT_SPP} by default, unless a noise level or a time limit is set.",
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
            "Stops each part of the picture once its noise (relative error) is this low.",
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
            "Stops after this time, however noisy the picture is.",
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
            "Size of the parts of the picture that workers render. Leave empty to have it chosen.",
            "px",
            section="Schedule",
        ),
    ] = None
    priority: Annotated[
        int,
        Setting(-100, 100, digest=False),
        SettingTexts("Priority", "Jobs with a higher number are rendered first.", section="Schedule"),
    ] = 0


WORK = table(Work)

ORDERS = Choices(
    {
        "in-turn": SettingTexts("In turn", "One frame after the other."),
        "every-nth": SettingTexts("Every n-th first", "Every n-th frame first, then those in between."),
        "centre-out": SettingTexts("Centre out", "From the middle of the shot outwards."),
        "breadth-first": SettingTexts(
            "Breadth first", "All frames roughly at first, then better and better: 1, 2, 4, 8 ... samples."
        ),
        "noisiest-first": SettingTexts("Noisiest first", "The noisiest frames first, so that all end equally clean."),
    }
)


@dataclass(frozen=True)
class ShotWork:
    """The fields of a request for several frames besides `Work`: frame rate, turntable and the order of frames."""

    fps: Annotated[
        float | None,
        Setting(1e-3, 1e4),
        SettingTexts("Frames a second", "Frame rate; by default that of the file, else 24.", section="Time"),
    ] = None
    turntable: Annotated[
        float | None,
        Setting(1e-3, 1e7),
        SettingTexts(
            "Turntable",
            "Time in which the camera circles its target once.",
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
            "Which frames are rendered first.",
            section="Time",
        ),
    ] = None
    every: Annotated[
        int, Setting(2, 1024, digest=False), SettingTexts("Every", "The n of the order “Every n-th first”.", section="Time")
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
