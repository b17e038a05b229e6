"""Renders a scene in this process, for `render` and `progressive`, and yields the picture after each pass over it."""

from __future__ import annotations

import contextlib
import queue
import threading
import warnings
from collections.abc import Callable, Generator
from pathlib import Path
from typing import TYPE_CHECKING

from rayfarm import options
from rayfarm.frame import PictureOrder, motion_of
from rayfarm.graphics_card import device_card, on_card_or_cores
from rayfarm.library.arguments import RenderArguments
from rayfarm.library.image import F32, Image
from rayfarm.reading import open_stage
from rayfarm.rendering import Clock, load_kernels
from renderer import aovs
from renderer.work import most_samples

if TYPE_CHECKING:
    from renderer.cuda.render import CardRenderer
    from renderer.film import Sums
    from renderer.scene.compiled import CompiledScene
    from renderer.settings import RenderSettings

__all__ = ["SceneWarning", "passes"]


class SceneWarning(UserWarning):
    """Warning about scene content that is not rendered as its file specifies."""


def passes(scene: Path, arguments: RenderArguments, at_once: bool) -> Generator[Image]:
    """Yields the picture after each pass; the last one is final. at_once: only the last. Passes not consumed are skipped.

    Closing the iterator ends the rendering. Raises SceneError, SettingsError or CommandError.
    """
    from renderer.film import noise as noise_of
    from renderer.render import render_frame

    picture, clock = arguments.picture, Clock()
    planes = [name for name in arguments.aovs if name != "color"]
    order = PictureOrder(picture, planes, arguments.denoise, 0.0, "neutral", None, 0, None, arguments.threads)
    light = picture.environment()
    with (
        device_card(arguments.device) as card,
        open_stage(
            *(scene, light, arguments.variant, picture.camera),
            threads=arguments.threads,
            shutter=picture.shutter(),
            placement=picture.placement(),
        ) as stage,
    ):
        motion = motion_of(stage, order, arguments.moment, clock)
        compiled, summary = stage.scene_at(arguments.moment)
        for warning in options.relevant_warnings(summary["warnings"], light):
            warnings.warn(warning, SceneWarning, stacklevel=2)
        settings = order.settings(summary, arguments.moment)
        count = most_samples(picture.spp, picture.noise, picture.time_limit, summary["defaults"])
        load_kernels(settings, compiled, clock, card)
        of = count if picture.noise is None else None

        def quiet_enough(sums: Sums) -> bool:
            return picture.noise is not None and noise_of(sums, settings.film_exponent) <= picture.noise

        def frame(stop: Callable[[Sums], bool] | None) -> Sums:
            limit, threads = picture.time_limit, arguments.threads

            def render_on(card: CardRenderer | None) -> Sums:
                return render_frame(compiled, settings, count, threads, stop=stop, time_limit=limit, card=card)

            return on_card_or_cores(card, render_on, warnings.warn)

        if at_once:
            sums = frame(None if picture.noise is None else quiet_enough)
            yield _image(sums, compiled, settings, of, planes, motion, arguments, True)
            return
        ready: queue.Queue[tuple[Sums, bool] | BaseException] = queue.Queue()
        is_left = threading.Event()

        def put_latest(news: tuple[Sums, bool] | BaseException) -> None:
            with contextlib.suppress(queue.Empty):
                ready.get_nowait()  # drop the outdated picture
            ready.put(news)

        def after_pass(sums: Sums) -> bool:
            put_latest((sums.copy(), False))
            return is_left.is_set() or quiet_enough(sums)

        def render() -> None:
            try:
                put_latest((frame(after_pass), True))
            except BaseException as error:
                put_latest(error)

        worker = threading.Thread(target=render, name="rayfarm-passes", daemon=True)
        worker.start()
        try:
            is_final = False
            while not is_final:
                found = ready.get()
                if isinstance(found, BaseException):
                    raise found
                sums, is_final = found
                yield _image(sums, compiled, settings, of, planes, motion, arguments, is_final)
        finally:
            is_left.set()
            worker.join()


def _image(
    sums: Sums,
    compiled: CompiledScene,
    settings: RenderSettings,
    total: int | None,
    planes: list[str],
    motion: F32 | None,
    arguments: RenderArguments,
    is_final: bool,
) -> Image:
    from renderer.film import ALBEDO, COLOR, NORMAL, SAMPLES, mean, noise

    exponent = settings.film_exponent

    def values(name: str) -> F32:
        if name == "color":
            return mean(sums, exponent)
        if name == "denoised":
            from renderer.denoise import denoise_with_guides
            from renderer.denoise_guides import denoise_still

            if is_final:
                return denoise_still(sums, compiled, settings, arguments.threads)
            color, albedo, normal = (mean(sums, exponent, each) for each in (COLOR, ALBEDO, NORMAL))
            return denoise_with_guides(color, albedo, normal, arguments.threads).color
        if name == aovs.MOTION:
            assert motion is not None
            return motion
        return aovs.values(sums, exponent, name, settings.light_planes)

    level = noise(sums, exponent)
    layers = aovs.parse_names(planes, settings.light_planes, is_transparent=settings.is_transparent)
    names = ["color", *layers, *(["denoised"] if arguments.denoise and is_final else [])]
    known = None if level == float("inf") else level
    return Image(names, values, float(sums[SAMPLES].mean()), total, known, is_final)
