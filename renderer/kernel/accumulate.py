"""Entry points that render a batch (a tile's pixels, over a range of sample numbers) into fixed-point sums."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import typeof

from renderer.arrays.scene import CompiledScene
from renderer.bvh.traverse import new_stack
from renderer.jit import entry, never_inline, subroutine
from renderer.kernel.backends.cpu.render import Part, pool_for, render_with_pool, stages
from renderer.kernel.backends.scalar.first_hit import FIRST_HIT_SLOTS
from renderer.kernel.backends.scalar.tile import render_tile
from renderer.kernel.camera import camera_frame
from renderer.kernel.light_groups import GROUP_ROW
from renderer.kernel.lineage.ao import trace_ao
from renderer.kernel.lineage.path import trace_special_path
from renderer.kernel.lineage.whitted import trace_whitted
from renderer.kernel.options import is_special, kernel_options
from renderer.kernel.path_trace import COLUMNS
from renderer.reference import Reference, by_reference
from renderer.settings import RenderSettings

__all__ = [
    "MAX_BAD",
    "Batch",
    "Output",
    "has_variants",
    "new_scratch",
    "path_scratch",
    "pool_stages",
    "renderer_of",
    "samples_caustics",
    "samples_guide",
]

Renderer = Callable[..., tuple[int, int]]

MAX_BAD = 64  # bad samples that are reported; further ones are only counted


class Batch(NamedTuple):
    """The samples to render: `count` samples from number `first` on, for each pixel of a tile whose upper left corner is (x, y).

    origin: the world position of the compiled scene's origin, as integers in units of the film's quantum (2**-film_exponent).
    It is added to the position of each first hit, since the kernel computes positions relative to that origin.
    """

    x: int
    y: int
    first: int
    count: int  # type: ignore[assignment]  # hides tuple.count, which is not used
    origin: tuple[int, int, int] = (0, 0, 0)


class Output(NamedTuple):
    """The arrays to which a batch's results are written."""

    sums: npt.NDArray[np.int64]  # (planes, h, w), added to; its size is the tile's
    bad: npt.NDArray[np.int64]  # (MAX_BAD, 3): x, y and number of samples that were NaN or infinite, which are not in the sums
    log: npt.NDArray[np.float64]  # rows for the last sample's path_trace.py, or none
    flat: npt.NDArray[np.int64]  # `sums` as one row of numbers
    # (pixels * count, columns), or no rows. Of each sample: 1 + number of the object and material that it hits; then nothing, or
    # float32 bits of its radiance and of DEEP (steps/record_first_hit.py), for deep pictures.
    records: npt.NDArray[np.uint32]
    path: npt.NDArray[np.float32]  # scratch memory of a path with light groups: its first hit, and the light of each group


# Each kernel is compiled at its first call. Frames are rendered by a separate path tracer without other features, which processes
# many paths at once.


# The scene is passed by reference to the functions that do the work (renderer/reference.py).


@subroutine
def _with_pool(scene, pool, camera, options, batch, output):
    never_inline()
    return render_with_pool(scene, pool, camera, options, batch, output)


@subroutine
def _by_path(scene, stack, camera, options, batch, output):
    never_inline()
    return render_tile(trace_special_path, scene, stack, camera, options, batch, output)


@subroutine
def _by_whitted(scene, stack, camera, options, batch, output):
    never_inline()
    return render_tile(trace_whitted, scene, stack, camera, options, batch, output)


@subroutine
def _by_ao(scene, stack, camera, options, batch, output):
    never_inline()
    return render_tile(trace_ao, scene, stack, camera, options, batch, output)


@entry
def _render_pool(scene, pool, camera, options, batch, output):
    return _with_pool(by_reference(scene), pool, camera, options, batch, output)


@entry
def _render_special_path(scene, stack, camera, options, batch, output):
    return _by_path(by_reference(scene), stack, camera, options, batch, output)


@entry
def _render_whitted(scene, stack, camera, options, batch, output):
    return _by_whitted(by_reference(scene), stack, camera, options, batch, output)


@entry
def _render_ao(scene, stack, camera, options, batch, output):
    return _by_ao(by_reference(scene), stack, camera, options, batch, output)


def has_variants(settings: RenderSettings) -> bool:
    """Returns True if there are variants of the kernel for these settings that leave out the features a scene does not use.

    There are for the pool path tracer only. Each other kernel is compiled once, with all features.
    """
    return renderer_of(settings) is _render_pool


def samples_caustics(settings: RenderSettings) -> bool:
    """Returns True if the kernel for these settings samples light through casters, in scenes with CausticTables."""
    return settings.caustics == "on" and settings.integrator == "path" and has_variants(settings)


def samples_guide(settings: RenderSettings) -> bool:
    """Returns True if the kernel for these settings samples a path guide (renderer/arrays/guide.py)."""
    return settings.guiding != "off" and settings.integrator == "path" and has_variants(settings)


def renderer_of(settings: RenderSettings) -> Renderer:
    """Returns the kernel that renders with these settings.

    There is none for the integrator of direct light only: it is the path tracer, limited to two segments.
    """
    if settings.integrator == "whitted":
        return _render_whitted
    if settings.integrator == "ao":
        return _render_ao
    if is_special(settings):
        return _render_special_path
    return _render_pool


def pool_stages(scene: CompiledScene, settings: RenderSettings) -> list[Part]:
    """Returns the functions of the pool path tracer that take longest to compile, from `stages` in backends/cpu/render.py.

    scene: an empty scene with the features of the wanted variant.
    """
    sums, bad, log = np.zeros((1, 0, 0), np.int64), np.zeros((0, 3), np.int64), np.zeros((0, COLUMNS))
    output = Output(sums, bad, log, sums.reshape(-1), np.zeros((0, 2), np.uint32), np.zeros(0, np.float32))
    given = pool_for(0, 0), camera_frame(settings), kernel_options(settings, scene), Batch(0, 0, 0, 0), output
    return stages(scene.has, scene.caustics, Reference(typeof(scene)), *given)


def new_scratch(renderer: Renderer, width: int, height: int, planes: int = 0, rows: int = 0) -> Any:
    """Returns the scratch memory that a kernel needs for a batch of a tile of width x height pixels.

    planes: number of light groups and paths with planes in the film. rows: from `group_rows` (options.py).
    """
    return pool_for(width, height, planes, rows) if renderer is _render_pool else new_stack()


def path_scratch(rows: int) -> npt.NDArray[np.float32]:
    """Returns the scratch memory `Output.path` for `rows` rows of a branch (`group_rows`); empty for none."""
    return np.zeros((FIRST_HIT_SLOTS + 2 * rows * GROUP_ROW) if rows else 0, np.float32)
