"""Renders one frame of a compiled scene in this process, and writes its files."""

from __future__ import annotations

import resource
import shlex
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rayfarm import options
from rayfarm.console import err
from rayfarm.graphics_card import on_card_or_cores
from rayfarm.output_files import write
from rayfarm.picture import Picture
from rayfarm.rendering import Clock, Show, part_of_frame, whole_frame
from renderer import aovs, cryptomatte
from renderer.frames import frame_text
from renderer.image.tonemap import Curve
from renderer.scene.animation import BETWEEN, Moment, Shutter
from renderer.scene.animation.orbit import orbit, orbit_over
from renderer.settings import RenderSettings, Tile, check_light_groups
from renderer.work import most_samples

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from rayfarm.reading import ConfinedScene
    from renderer.cuda.render import CardRenderer
    from renderer.deep import Deep
    from renderer.denoise import DenoisedPicture
    from renderer.film import Sums
    from renderer.render import RenderStats
    from renderer.scene.compiled import CompiledScene
    from renderer.temporal_denoise import DenoisedFrame

    F32 = npt.NDArray[np.float32]
    Hold = Callable[[DenoisedFrame, Callable[[F32], None]], None]

__all__ = ["PictureOrder", "camera_options", "moment_options", "motion_of", "render_to", "report_bad_samples", "statistics"]


@dataclass(frozen=True)
class PictureOrder:
    """Options of the command line that apply to every frame: the picture, further outputs, and their format."""

    picture: Picture
    planes: list[str]  # further layers
    denoise: bool
    exposure: float
    curve: Curve
    tile: Tile | None  # only this rectangle
    first: int  # sample number
    turntable: float | None  # seconds in which the camera goes around once
    threads: int | None
    strict: bool = False  # whether a scene's warnings are errors
    card: CardRenderer | None = None  # renders instead of the CPU
    gain_map: bool = False  # of a .jpg

    def settings(self, summary: dict[str, Any], moment: Moment, shutter: Shutter | None = None) -> RenderSettings:
        """Returns the render settings at a moment. summary: of the scene. shutter: replaces the requested one.

        Raises CommandError or SettingsError.
        """
        settings = self.picture.settings(summary["cameras"], summary["defaults"])
        check_light_groups(settings.light_groups, summary["light_groups"])
        if self.turntable is None:
            return settings
        turns = moment.seconds(summary["fps"]) / self.turntable
        shutter = shutter or Shutter(settings.shutter, settings.shutter_at, settings.shutter_keys)
        views = orbit_over(settings.view, settings.views, moment, shutter, summary["fps"], self.turntable, summary["up"])
        return replace(settings, view=orbit(settings.view, turns, summary["up"]), views=views)

    def files(self, output: Path) -> list[Path]:
        """Returns the paths of a frame's files: its picture and, if requested, the denoised and the deep one.

        A deep one that only the scene's own settings request is not among them. It is written before the picture.
        """
        denoised = [options.denoised_name(output)] if self.denoise else []
        return [output, *denoised, *([options.deep_name(output)] if self.picture.given.get("deep") else [])]


def motion_of(stage: ConfinedScene, order: PictureOrder, moment: Moment, clock: Clock, needed: bool = False) -> F32 | None:
    """Returns the frame's motion vectors if they are requested or `needed`, else None.

    The stage's scene is then no longer valid.
    """
    if not needed and aovs.MOTION not in order.planes:
        return None
    from renderer.vectors import motion_vectors

    compiled, summary = stage.between_neighbours(moment)
    found = motion_vectors(compiled, order.settings(summary, moment, BETWEEN), order.threads)
    clock.end_step("motion_s")
    return found


def render_to(
    output: Path,
    order: PictureOrder,
    compiled: CompiledScene,
    summary: dict[str, Any],
    settings: RenderSettings,
    clock: Clock,
    show: Show,
    motion: F32 | None = None,
    hold: Hold | None = None,
    writes: bool = True,
    on_picture: Callable[[F32, F32], None] = lambda picture, objects: None,
) -> RenderStats:
    """Renders a frame and writes its pictures atomically. summary: of the scene.

    motion: from `motion_of`. hold: if given, called with the denoised frame and a function that writes a picture to its file,
    instead of writing the denoised frame. writes: whether to write the raw picture. on_picture: called with the raw picture,
    (h, w, 3), and the AOV `object`, (h, w): 1 + the number, 0 where nothing is hit.
    """
    from renderer.denoise_guides import denoise_still
    from renderer.film import SAMPLES, mean
    from renderer.image import encode
    from renderer.render import RenderStats
    from renderer.temporal_denoise import DenoisedFrame

    picture = order.picture
    groups = settings.light_planes
    asked = aovs.parse_names(order.planes, groups, settings.cryptomatte, settings.is_transparent)  # refused before rendering
    count = most_samples(picture.spp, picture.noise, picture.time_limit, summary["defaults"])

    def render(card: CardRenderer | None) -> tuple[Sums, RenderStats]:
        done = RenderStats()
        if order.tile is None and order.first == 0:
            limits = picture.noise, picture.time_limit
            return whole_frame(compiled, settings, count, order.threads, *limits, done, show, card), done
        tile = order.tile or Tile(0, 0, settings.width, settings.height)
        return part_of_frame(compiled, settings, tile, order.first, count, done, card), done

    sums, done = on_card_or_cores(order.card, render, _print_note)
    clock.end_step("render_s")
    names = [name for name in asked if name not in (aovs.MOTION, aovs.ALPHA)]
    planes = {name: aovs.values(sums, settings.film_exponent, name, groups) for name in names if not aovs.is_matte(name)}
    if motion is not None and aovs.MOTION in order.planes:
        planes[aovs.MOTION] = motion
    known_names = {kind: summary[kind] for kind in ("objects", "materials")}
    channels, header = aovs.layers(planes), None
    if any(map(aovs.is_matte, names)):
        mattes = cryptomatte.layers(done.hits or cryptomatte.no_hits(), sums[SAMPLES], settings.cryptomatte, known_names)
        channels |= {name: mattes[..., k] for k, name in enumerate(cryptomatte.channel_names(settings.cryptomatte))}
        header = cryptomatte.header(known_names)
    looks: dict[str, Any] = {"exposure": order.exposure, "curve": order.curve, "channels": channels, "header": header}
    if settings.is_transparent:
        looks["alpha"] = aovs.values(sums, settings.film_exponent, aovs.ALPHA, groups)
    looks["gain_map"] = order.gain_map
    raw = mean(sums, settings.film_exponent)
    on_picture(raw, aovs.values(sums, settings.film_exponent, "object", groups))
    if writes and done.deep is not None:  # before the picture: a run that continues renders frames without one
        _write_deep(options.deep_name(output), done.deep, sums, settings)
    if writes:
        encode.write(output, raw, **looks)
    if order.denoise:
        if hold is None or motion is None:
            still = denoise_still(sums, compiled, settings, order.threads)
            encode.write(options.denoised_name(output), still, **looks)
        else:
            clean = _denoise_frame(sums, settings.film_exponent, order.threads)
            number, material = (aovs.values(sums, settings.film_exponent, name) for name in ("object", "material"))
            hold(
                DenoisedFrame(clean, number, material, motion),
                lambda picture: encode.write(options.denoised_name(output), picture, **looks),
            )
        clock.end_step("denoise_s")
    return done


def _write_deep(path: Path, deep: Deep, sums: Sums, settings: RenderSettings) -> None:
    from renderer.deep_samples import deep_rows
    from renderer.image.deep_exr import write_deep

    rows = deep_rows(deep, sums, settings.film_exponent, len(settings.light_planes), settings.is_transparent)
    with tempfile.TemporaryDirectory(prefix="rayfarm-") as folder:
        made = Path(folder) / "deep.exr"
        write_deep(made, [rows], settings.width, settings.height)
        write(path, made.read_bytes())


def _denoise_frame(sums: Sums, film_exponent: int, threads: int | None) -> DenoisedPicture:
    from renderer.denoise import denoise_with_guides
    from renderer.film import ALBEDO, COLOR, NORMAL, mean

    color, albedo, normal = (mean(sums, film_exponent, channel) for channel in (COLOR, ALBEDO, NORMAL))
    return denoise_with_guides(color, albedo, normal, threads)


def report_bad_samples(scene: Path, settings: RenderSettings, stats: RenderStats, extra_options: str = "") -> None:
    """Prints how many samples were discarded, and the command that traces the first of them. extra_options: added to it."""
    if not stats.bad_count:
        return
    from protocol.reproduce import sample_command

    command = sample_command(settings, *stats.bad[0]).replace("SCENE", str(scene), 1)
    sentence = f"note: {stats.bad_count} samples were not finite and are left out. To follow the first: {command}{extra_options}"
    err.print(sentence, markup=False, soft_wrap=True)


def moment_options(moment: Moment) -> str:
    """Returns the command line options for a moment, each preceded by a space; "" for frame 0 with default clip and rate."""
    words = [f"--frame={frame_text(moment.frame)}"] if moment.frame else []
    words += [f"--fps={moment.fps!r}"] if moment.fps is not None else []
    words += [f"--clip={shlex.quote(moment.clip)}"] if moment.clip is not None else []
    return "".join(f" {word}" for word in words)


def _print_note(sentence: str) -> None:
    err.print(f"note: {sentence}", markup=False, soft_wrap=True)


def camera_options(order: PictureOrder, settings: RenderSettings) -> str:
    """Returns the command line options for a camera that moves while the shutter is open; "" for a static camera.

    Each is preceded by a space.
    """
    if not settings.views:
        return ""
    words = [f"--{name}={shlex.quote(str(value))}" for name, value in order.picture.camera_options().items()]
    words += [f"--turntable={order.turntable!r}"] if order.turntable is not None else []
    return "".join(f" {word}" for word in words)


def statistics(clock: Clock, stats: RenderStats) -> dict[str, Any]:
    """Returns the statistics of a frame for --stats."""
    scale = 1 if sys.platform == "darwin" else 1024  # ru_maxrss: bytes there, KiB on Linux
    return {
        **clock.seconds,
        "render_cpu_s": clock.cpu_seconds["render_s"],
        "samples": stats.samples,
        "rays": stats.rays,
        "bad_samples": stats.bad_count,
        "bad": [bad._asdict() for bad in stats.bad],
        "samples_per_s": stats.samples / max(clock.seconds["render_s"], 1e-9),
        "peak_memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale,
    }
