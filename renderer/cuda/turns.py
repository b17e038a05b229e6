"""The loop that launches the wavefront's kernels (renderer/kernel/backends/cuda/wavefront.py)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from renderer.arrays.scene import CompiledScene
from renderer.kernel.backends.cuda.wavefront import scattering_kernels

__all__ = ["paths_for", "take_turns"]

_MOST_PATHS = 1 << 20  # under way
_WARP = 32
_SHARE = 4  # of a card's memory, one part is for paths
_UNCHECKED = 4  # turns from one look at the number of active paths to the next, for which the card has to stop


def paths_for(samples: int, memory: int, size: int, most: int | None = None) -> int:
    """Returns the number of paths of a batch that are under way at once, plus one for the spare row.

    samples: of the batch. memory: of the card, in bytes. size: bytes per path. most: limit for measurements; None: the usual one.
    """
    paths = min(most or _MOST_PATHS, samples, memory // _SHARE // size)
    return -(-(paths + 1) // _WARP) * _WARP


def take_turns(
    launch: Callable[[str, int, bool], None], count_active: Callable[[], int], scene: CompiledScene, options: Any, paths: int
) -> None:
    """Renders a Wave by launching its kernels in turn, until no path is under way.

    launch(kernel, threads, second) launches a kernel with the Wave, with that value of its field `second`. count_active: returns
    the number of active paths, after all kernels launched before. paths: rows of the Wave for first branches.
    """
    lit = scene.environment_frame[3] > 0 or len(scene.light_primitive) > 0
    has_media = scene.has.media is not None
    splitting, others = scattering_kernels(scene.has)
    launch("free_rows", paths - 1, False)
    if has_media:
        launch("find_camera_media", 1, False)
    turn = 0
    while True:
        launch("start_paths", paths, False)
        launch("begin_turn", 1, False)
        if turn % _UNCHECKED == 0 and count_active() == 0:
            return
        turn += 1
        launch("trace_rays", 2 * paths, False)
        if has_media:
            launch("sample_free_flights", 2 * paths, False)
        launch("end_rays", 1, False)
        launch("shade_misses", 2 * paths, False)
        launch("shade_hits", 2 * paths, False)
        if has_media:
            launch("trace_subsurface", 2 * paths, False)
        if scene.caustics is not None:
            launch("sample_caustics", 2 * paths, False)
        if lit:
            launch("choose_lights", 2 * paths, False)
        if options.splitting > 1:
            for kernel in splitting:
                launch(kernel, 2 * paths, True)
        for kernel in (*splitting, *others):
            launch(kernel, 2 * paths, False)
        if lit:
            launch("trace_shadow_rays", 2 * paths, False)
        if scene.caustics is not None:
            launch("add_caustics", 2 * paths, False)
        launch("end_paths", 2 * paths, False)
