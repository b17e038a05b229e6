"""Renders in this process: reads and compiles a scene, renders a frame or part of one, and measures each step."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rayfarm.console import PlainProgress, bar
from rayfarm.errors import CommandError
from rayfarm.options import Env, Placement
from rayfarm.reading import ConfinedScene, open_stage
from renderer.scene.animation import Moment
from renderer.settings import RenderSettings, Tile

if TYPE_CHECKING:
    from renderer.cuda.render import CardRenderer
    from renderer.film import Sums
    from renderer.render import RenderStats
    from renderer.scene.compiled import CompiledScene

__all__ = ["Clock", "Show", "load_kernels", "load_scene", "part_of_frame", "show_progress", "whole_frame"]

Show = Callable[[int, int], None]  # called with the number of samples done, and their total


class Clock:
    """Measures the wall time, and the processor time of all threads, of each step, in seconds.

    A step begins when the last one ends.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}
        self._last = time.perf_counter(), time.process_time()

    def end_step(self, step: str) -> None:
        """Ends a step with this name and records its times."""
        now = time.perf_counter(), time.process_time()
        self.seconds[step], self.cpu_seconds[step] = now[0] - self._last[0], now[1] - self._last[1]
        self._last = now


def load_scene(
    scene: Path,
    environment: Env,
    clock: Clock,
    brute: bool = False,
    variant: str | None = None,
    threads: int | None = None,
    moment: Moment = Moment(),
    camera: str | None = None,
    shutter: Mapping[str, Any] = MappingProxyType({}),
    before: Callable[[ConfinedScene], None] = lambda stage: None,
    root: Path | None = None,
    placement: Placement = Placement(),
) -> tuple[CompiledScene, dict[str, Any]]:
    """Reads and compiles a scene; returns it with its summary. brute: without a BVH. variant: material variant.

    threads: None: all cores. moment: the time within an animation. camera: as in --camera. shutter: the given shutter settings.
    before: called first, while the scene's files are open. root: a folder that contains the scene; the scene may refer to all
    files in it.
    """
    with bar() as progress, open_stage(scene, environment, variant, camera, brute, threads, shutter, root, placement) as stage:
        task = progress.add_task("reading", total=None)

        def show_step(step: str) -> None:
            if step == "building":
                clock.end_step("load_s")
            progress.update(task, description=step)

        before(stage)
        found = stage.scene_at(moment, show_step)
        clock.end_step("build_s")
    return found


def load_kernels(settings: RenderSettings, compiled: CompiledScene, clock: Clock, card: CardRenderer | None = None) -> None:
    """Loads the kernel for these settings and this scene, on the graphics card if one is used; compiles it if needed.

    With `guiding` it trains the guide first, which decides on the kernel.
    Called after the scene was read, so that errors in its files are reported before the wait.
    """
    from renderer.render import check_for_cards, settings_as_rendered, variant_for, warm_up
    from renderer.variant_names import variant_suffix

    with bar() as progress:
        progress.add_task("loading the kernel (the first time compiles it: about half a minute)", total=None)
        if card is not None:
            check_for_cards(settings)
        variant = variant_for(settings, compiled)
        if settings.guiding != "off":
            settings = settings_as_rendered(settings, compiled)
            clock.end_step("guide_s")
        if card is None:
            warm_up(settings, variant, prepares=False)
        else:
            card.load(f"{variant}{variant_suffix(settings)}")
    clock.end_step("compile_s")


@contextlib.contextmanager
def show_progress() -> Iterator[Show]:
    """Context manager that shows the progress of one frame, as a bar or as plain lines.

    Yields the function to call with the progress.
    """
    ticker = PlainProgress()
    with bar() as progress:
        task = progress.add_task("rendering", total=None)

        def update_bar(part: int, total: int) -> None:
            progress.update(task, completed=part, total=total)
            ticker.print_if_due(f"rendering: {100 * part / max(total, 1):.0f} %")

        yield update_bar


def whole_frame(
    compiled: CompiledScene,
    settings: RenderSettings,
    spp: int,
    threads: int | None,
    noise: float | None,
    time_limit: float | None,
    stats: RenderStats,
    show: Show,
    card: CardRenderer | None = None,
) -> Sums:
    """Renders the whole frame, with a graphics card if given, and returns its sums.

    noise: target relative noise, with at least `least_samples` samples per pixel.
    """
    from renderer.film import SAMPLES, least_samples
    from renderer.film import noise as noise_of
    from renderer.render import render_frame

    def quiet_enough(sums: Sums) -> bool:
        if noise is None or int(sums[SAMPLES].max()) < least_samples(sums[SAMPLES].size):
            return False
        return noise_of(sums, settings.film_exponent) <= noise

    return render_frame(
        compiled, settings, spp, threads, progress=show, stats=stats, stop=quiet_enough, time_limit=time_limit, card=card
    )


def part_of_frame(
    compiled: CompiledScene,
    settings: RenderSettings,
    tile: Tile,
    first: int,
    count: int,
    stats: RenderStats,
    card: CardRenderer | None = None,
) -> Sums:
    """Renders one batch into an otherwise empty frame, like a worker of a farm; returns the frame's sums.

    Raises CommandError if the tile is not inside the picture.
    """
    import numpy as np

    from renderer import cryptomatte, deep
    from renderer.film import plane_count
    from renderer.render import check_for_cards, render_batch

    x, y, w, h = tile
    if min(x, y) < 0 or min(w, h) < 1 or x + w > settings.width or y + h > settings.height:
        raise CommandError(f"--tile reaches out of the picture of {settings.width}x{settings.height} pixels")
    if card is not None:
        check_for_cards(settings)
    batch = render_batch(compiled, settings, tile, first, count, card)
    sums = np.zeros((plane_count(len(settings.light_planes), settings.is_transparent), settings.height, settings.width), np.int64)
    sums[:, y : y + h, x : x + w] = batch.sums
    if batch.hits is not None:
        stats.hits = cryptomatte.moved(batch.hits, x, y, w, settings.width)
    if batch.deep is not None:
        stats.deep = deep.moved(batch.deep, x, y, w, settings.width)
    stats.samples, stats.bad, stats.bad_count = w * h * count, batch.bad, batch.bad_count
    return sums
