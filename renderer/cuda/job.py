"""The argument of the GPU kernels, a Wave: its type for each kernel variant."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import typeof

from renderer.arrays.scene import CompiledScene
from renderer.bvh.compressed_tree import LEAF_NUMBERS, NODE_WORDS, CompressedTree
from renderer.cryptomatte import NOT_FINITE
from renderer.film import plane_count
from renderer.kernel.accumulate import Batch
from renderer.kernel.backends.cpu.rows import CAUSTIC_ROW, LAYOUT
from renderer.kernel.backends.cuda.wavefront import COUNTERS, LISTS, Wave
from renderer.kernel.camera import Camera, camera_frame
from renderer.kernel.draft import GUIDE_VALUES, LIGHT_VALUES
from renderer.kernel.light_groups import GROUP_ROW
from renderer.kernel.options import Options, kernel_options
from renderer.variant_names import example_of

__all__ = ["bytes_per_path", "wave_for", "wave_type"]

_NOTHING: Any = None  # replaces the arrays of the processor's tree


def bytes_per_path(scene: CompiledScene, options: Options) -> int:
    """Returns how many bytes a path takes in the arrays of a Wave with this scene and these options."""
    return 2 * 4 * (_columns(scene, options) + LISTS) + 8


def _columns(scene: CompiledScene, options: Options) -> int:
    """Returns the number of float32 in a path's row, with its light by group and path, and its CausticPath."""
    return LAYOUT.width + int(options.group_rows) * GROUP_ROW + (CAUSTIC_ROW if scene.caustics is not None else 0)


def wave_for(
    scene: CompiledScene,
    camera: Camera,
    options: Options,
    batch: Batch,
    width: int,
    height: int,
    paths: int,
    second: bool = False,
    recorded: int = 0,
    draft_exposure: float | None = None,
) -> Wave:
    """Returns the Wave that renders a batch of a tile of width x height pixels into a zeroed film, `paths` - 1 paths at once.

    scene: with a compressed tree, in the form that the variant's kernels expect. recorded: number of columns of the records of
    samples; 0 for no records. draft_exposure: of a draft of the film, in stops; None: no draft. The rows and lists of the paths
    and the arrays of the draft are not initialised.
    """
    pool, lists = np.empty((_columns(scene, options), 2 * paths), np.float32), np.empty((LISTS, 2 * paths), np.uint32)
    lengths, branches = np.zeros(LISTS, np.int64), np.empty(paths, np.int64)
    planes = plane_count(int(options.groups) + int(options.paths), options.transparent_background)
    film = np.zeros((planes, height, width), np.int64)
    counters = np.zeros(COUNTERS, np.int64)
    records = np.full((width * height * batch.count if recorded else 0, recorded or 2), NOT_FINITE, np.uint32)
    size = (0, 0) if draft_exposure is None else (height, width)
    draft, light = np.empty(size, np.uint32), np.empty((2, *size, LIGHT_VALUES), np.float32)
    of_draft = draft, light, np.empty((*size, GUIDE_VALUES), np.float32), np.float32(2.0 ** (draft_exposure or 0.0)), np.int64(0)
    arrays = film, counters, pool, lists, lengths, branches, records
    return Wave(scene, camera, options, batch, *arrays, np.bool_(second), *of_draft)


def wave_type(variant: str) -> Any:
    """Returns the Numba type of Wave for a kernel variant, named as in renderer/variant_names.py."""
    scene, settings = example_of(variant)
    tree = CompressedTree(np.zeros((1, NODE_WORDS), np.uint32), np.zeros((1, LEAF_NUMBERS), np.float32))
    scene = scene._replace(bvh=scene.bvh._replace(node=_NOTHING, packet=_NOTHING, compressed=tree))
    return typeof(wave_for(scene, camera_frame(settings), kernel_options(settings, scene), Batch(0, 0, 0, 0), 0, 0, paths=1))
