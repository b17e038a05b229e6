"""Places arrays next to inaccessible memory pages, and renders features with all kernel arrays placed this way.

`python -m tests.renderer.fenced SIDE KERNEL FEATURE ...` prints each feature before rendering it, and crashes with SIGSEGV if the
kernel accesses memory outside an array. SIDE is `behind` or `before`, the end of each array at which the inaccessible page is, or
`checked`: arrays are placed as usual, and kernels are compiled with bounds checks, which raise IndexError. Such kernels need a
separate cache ($RAYFARM_CACHE). Bounds checks do not cover reads by address, as for eight lanes at once.
"""

from __future__ import annotations

import ctypes
import faulthandler
import mmap
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from renderer import render, target
from renderer.arrays.scene import CompiledScene, example, flat
from renderer.kernel import accumulate
from renderer.kernel.accumulate import Output
from renderer.settings import RenderSettings

SIDES = ("behind", "before")
CHECKED = "checked"
KERNELS = ("pool", "path", "whitted", "ao")

_PAGE = mmap.PAGESIZE
_PROT_NONE = 0
_libc = ctypes.CDLL(None, use_errno=True)
_libc.mprotect.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
_kept: list[Any] = []  # the memory is never freed


def fenced(array: np.ndarray, side: str) -> np.ndarray:
    """Returns a copy of the array with an inaccessible page directly behind or before its elements.

    For `checked`, returns the array itself.
    """
    if side == CHECKED:
        return array
    pages = max(-(-array.nbytes // _PAGE), 1)
    memory = mmap.mmap(-1, (pages + 2) * _PAGE)
    _kept.append(memory)
    start = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    for page in (0, pages + 1):
        if _libc.mprotect(start + page * _PAGE, _PAGE, _PROT_NONE):
            raise OSError(ctypes.get_errno(), "mprotect")
    offset = (pages + 1) * _PAGE - array.nbytes if side == "behind" else _PAGE
    copy: np.ndarray = np.frombuffer(memory, array.dtype, array.size, offset).reshape(array.shape)
    copy[...] = array
    copy.flags.writeable = array.flags.writeable
    return copy


def fenced_scene(scene: CompiledScene, side: str) -> CompiledScene:
    """Returns the scene, of any variant, with every array fenced."""
    arrays = {name: fenced(array, side) for name, array in flat(scene).items() if array is not None}
    of_tree = {name[4:]: array for name, array in arrays.items() if name.startswith("bvh.")}
    rest = {name: array for name, array in arrays.items() if not name.startswith("bvh.")}
    return scene._replace(bvh=scene.bvh._replace(**of_tree), **rest)


def _fence(side: str) -> None:
    """Makes the renderer pass fenced copies of its arrays to kernels. side: as in `fenced`."""
    prepared, scratch = render._prepared, render.new_scratch

    def given(*arguments: Any) -> Any:
        made = scratch(*arguments)
        return type(made)(*(fenced(each, side) for each in made)) if isinstance(made, tuple) else fenced(made, side)

    def output(sums: np.ndarray, bad: np.ndarray, log: np.ndarray, _: np.ndarray, ids: np.ndarray, path: np.ndarray) -> Output:
        shared = _shared(sums, side)
        return Output(
            shared, *(fenced(each, side) for each in (bad, log)), shared.reshape(-1), fenced(ids, side), fenced(path, side)
        )

    render._prepared = lambda *arguments: fenced_scene(prepared(*arguments), side)
    render.new_scratch = given
    render.Output = output  # type: ignore[misc,assignment]
    render.example = lambda: fenced_scene(example(), side)  # type: ignore[attr-defined]


def _shared(sums: np.ndarray, side: str) -> np.ndarray:
    made = fenced(sums, side)
    _films.append(made)
    return made


_films: list[np.ndarray] = []


def _by_pool(scene: CompiledScene, settings: RenderSettings) -> None:
    render.render_batch(scene, settings, render.Tile(0, 0, settings.width, settings.height), 0, 2)
    assert _films[-1].any() or settings.max_depth == 1 or not scene.environment_frame[3]
    render.replay(scene, settings, settings.width // 2, settings.height // 2, 1)


def _by_path(scene: CompiledScene, settings: RenderSettings) -> None:
    render.renderer_of = lambda _: accumulate._render_special_path  # type: ignore[assignment]
    render.has_variants = lambda _: False
    _by_pool(scene, settings)


def _by_whitted(scene: CompiledScene, settings: RenderSettings) -> None:
    scene = scene._replace(object_links=scene.object_links[:0])  # which it refuses
    _by_pool(scene, RenderSettings.from_json({**settings.to_json(), "integrator": "whitted"}))


def _by_ao(scene: CompiledScene, settings: RenderSettings) -> None:
    _by_pool(scene, RenderSettings.from_json({**settings.to_json(), "integrator": "ao"}))


RENDER: dict[str, Callable[[CompiledScene, RenderSettings], None]] = {
    "pool": _by_pool,
    "path": _by_path,
    "whitted": _by_whitted,
    "ao": _by_ao,
}


def main(side: str, kernel: str, *names: str) -> None:
    """Renders each feature named on the command line; the name "warm-up of VARIANT" runs `warm_up` instead."""
    from tests.renderer.kernel.backends.features import made

    faulthandler.enable()
    if side == CHECKED:
        target._Context.enable_boundscheck = True
    _fence(side)
    for name in names:
        print(name, flush=True)
        _kept.clear()
        _films.clear()
        if name.startswith("warm-up of "):
            render.warm_up(variant=name.removeprefix("warm-up of "), prepares=False)
        else:
            RENDER[kernel](*made(name))


if __name__ == "__main__":
    main(*sys.argv[1:])
