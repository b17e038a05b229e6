"""Compiles the kernels that the ordinary tests render with (`python -m tests.kernels`), in processes beside the tests.

Two variants serve scenes that stand still, `plain` and `full`; scenes that move or have media all take `moving-media`, the
one variant that has everything (`few_variants`). The tests of `--long` compile the others when they come to them.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from worker.machine.children import die_with_parent

if TYPE_CHECKING:
    from renderer.arrays.scene import CompiledScene
    from renderer.settings import RenderSettings

__all__ = ["few_variants", "get_ready", "ready_first"]


def get_ready(edition: str, **settings: Any) -> None:
    """Compiles or loads the kernel of an edition, without the processes that help: the tests fill all processors."""
    from renderer.beside import Helpers
    from renderer.render import warm_up
    from renderer.settings import RenderSettings, View

    picture = RenderSettings(2, 2, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))
    warm_up(replace(picture, **settings), edition, helpers=Helpers(edition, wanted=False))


@contextmanager
def ready_first() -> Iterator[None]:
    """Has every render in this process get its kernel ready first: one process compiles it, the others wait and load it."""
    from renderer import render
    from renderer.arrays.has import EDITIONS
    from renderer.beside import Helpers

    prepared = render._prepared

    def ready(scene: CompiledScene, settings: RenderSettings) -> Any:
        made = prepared(scene, settings)
        edition = next(name for name, has in EDITIONS.items() if has == made.has)
        if not render.is_warm(settings, edition):
            render.warm_up(settings, edition, helpers=Helpers(edition, wanted=False))
        return made

    render._prepared = ready
    try:
        yield
    finally:
        render._prepared = prepared


@contextmanager
def few_variants() -> Iterator[None]:
    """Has scenes that move or have media rendered by the variant that has both."""
    from renderer import render

    chosen = render.edition_of

    def edition_of(scene: CompiledScene, camera_moves: bool = False) -> str:
        edition = chosen(scene, camera_moves)
        return render.MOVING_MEDIA if edition in (render.MOVING, render.MEDIA) else edition

    render.edition_of = edition_of
    try:
        yield
    finally:
        render.edition_of = chosen


def main() -> None:
    """Compiles what farms begin with; then, side by side, all else."""
    from renderer.render import FULL, MOVING_MEDIA, PLAIN

    gc.disable()  # a twelfth of the time, and what compiles has next to none
    get_ready(PLAIN)
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        die_with_parent(parent)
        get_ready(MOVING_MEDIA)
        os._exit(0)
    get_ready(FULL)
    get_ready(FULL, sampling="light")  # one path at a time
    if os.waitpid(child, 0)[1] != 0:
        raise SystemExit(f"the kernel of {MOVING_MEDIA} does not compile")


if __name__ == "__main__":
    main()
