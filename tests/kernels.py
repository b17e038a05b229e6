"""Compiles the kernels of the default tests in processes parallel to them (`python -m tests.kernels pool`, `... path`).

These are the variants `plain` and `full`, and the kernel for one path at a time. Tests that need others (motion, media, Whitted,
ambient occlusion, caustics, guiding) are marked `long`.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from renderer.arrays.scene import CompiledScene
    from renderer.settings import RenderSettings

__all__ = ["get_ready", "ready_first"]


def get_ready(variant: str, **settings: Any) -> None:
    """Compiles or loads the kernel variant, in this process alone, since the tests already use all processors."""
    from renderer.parallel_compile import Helpers
    from renderer.render import warm_up
    from renderer.settings import RenderSettings, View

    picture = RenderSettings(2, 2, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))
    warm_up(replace(picture, **settings), variant, helpers=Helpers(variant, wanted=False))


@contextmanager
def ready_first(is_ordinary: bool) -> Iterator[None]:
    """Prepares the kernel before each render in the `with` block: one process compiles the kernel, the others wait and load it.

    is_ordinary: whether to fail a test that needs a kernel which `main` does not compile.
    """
    import pytest  # `main` runs while it is being installed

    from renderer import render
    from renderer.arrays.scene_features import KERNEL_VARIANTS
    from renderer.kernel.accumulate import samples_caustics, samples_guide
    from renderer.parallel_compile import Helpers
    from renderer.render import FULL, PLAIN

    prepared = render._prepared

    def ready(scene: CompiledScene, settings: RenderSettings, variant: str | None = None) -> Any:
        made = prepared(scene, settings, variant)
        of_scene = made.has._replace(groups=None, light_paths=None, by_light=None)
        variant = next(name for name, has in KERNEL_VARIANTS.items() if has == of_scene)
        is_other = settings.light_planes or settings.integrator in ("whitted", "ao")
        settings = render.settings_of_prepared(settings, made)
        is_other = is_other or samples_caustics(settings) or samples_guide(settings) or settings.is_spectral
        if is_ordinary and (is_other or variant not in (PLAIN, FULL)):
            pytest.fail("this would compile one more kernel: mark it `long`")
        if not render.is_warm(settings, variant):
            render.warm_up(settings, variant, helpers=Helpers(variant, wanted=False))
        return made

    render._prepared = ready
    try:
        yield
    finally:
        render._prepared = prepared


def _prepare_readers() -> None:
    """Compiles the parser of OBJ files and the builder of light trees, which several processes would compile at the same time."""
    from renderer.scene.compile import compile_scene
    from renderer.scene.description import Light, Material, SceneDescription, Sphere
    from renderer.scene.lights import TREE_FROM
    from renderer.scene.readers.obj_lines import parse

    parse(b"v 0 0 0\n", "one-vertex.obj")
    lights = [Light("point", position=(0.0, 0.0, float(n))) for n in range(TREE_FROM)]
    compile_scene(SceneDescription(spheres=[Sphere((0.0, 0.0, -9.0), 1.0, 0)], materials=[Material()], lights=lights))


def main(kernels: str) -> None:
    """Compiles the kernels of the pool, those needed by farms first, or the kernel for one path at a time.

    kernels: "pool" or "path".
    """
    gc.disable()  # garbage collection takes 1/12 of the time, and compilation leaves almost no garbage
    if kernels == "path":
        get_ready("full", sampling="light")
        return
    get_ready("plain")
    _prepare_readers()
    get_ready("full")


if __name__ == "__main__":
    main(sys.argv[1])
    os._exit(0)  # freeing a million objects one by one takes two seconds
