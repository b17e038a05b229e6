"""Who compiles the kernels that the tests render with: processes of their own, from the start on (`python -m tests.kernels`).

The tests are spread over processes, and farms have some of their own. Each would compile what it comes to first, all of them the
same at the same time.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import psutil

from tests.helpers import ROOT
from worker.machine.children import die_with_parent, spawn_guard

if TYPE_CHECKING:
    from renderer.arrays.scene import CompiledScene
    from renderer.settings import RenderSettings

__all__ = ["compiling_beside", "ready_first", "wait_for_farms"]

COMPILER = "RAYFARM_TESTS_COMPILER"  # in the environment of all tests: the process that compiles


@contextmanager
def compiling_beside() -> Iterator[None]:
    """They are compiled meanwhile. If that fails, whoever wants a kernel compiles it, and says why it fails."""
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    other = subprocess.Popen([sys.executable, "-m", "tests.kernels"], cwd=ROOT, preexec_fn=spawn_guard(), **quiet)
    os.environ[COMPILER] = str(other.pid)
    try:
        yield
    finally:
        del os.environ[COMPILER]
        other.kill()
        other.wait()


def wait_for_farms() -> None:
    """Until all that farms render with is compiled, where that process does it: else who waits for a picture waits for it too."""
    from renderer.jit import cache_folder
    from renderer.render import FULL, MOVING, PLAIN, kernel_name

    compiler = int(os.environ.get(COMPILER, "0"))
    wanted = [cache_folder() / f"{kernel_name(edition=edition)}.done" for edition in (PLAIN, FULL, MOVING)]
    while compiler and not all(done.exists() for done in wanted) and _runs(compiler):
        time.sleep(0.2)


def _runs(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@contextmanager
def ready_first() -> Iterator[None]:
    """Who renders in this process without having got the kernel ready does that first, as the command and the workers do: of
    all processes one compiles it, the others wait and load it.
    """
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


def main() -> None:
    """What farms begin with; then, side by side, what farms want next and what else the tests render with.

    Without helpers: the tests have something to do for every core, and each helper finds out again much of what others have.
    """
    from renderer.beside import Helpers
    from renderer.render import FULL, MEDIA, MOVING, PLAIN, warm_up
    from renderer.settings import RenderSettings, View

    def compiled(edition: str, **other: str) -> None:
        warm_up(replace(settings, **other), edition, helpers=Helpers(edition, wanted=False))

    gc.disable()  # a twelfth of the time, and what compiles has next to none
    settings = RenderSettings(2, 2, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))
    compiled(PLAIN)
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        die_with_parent(parent)
        compiled(MOVING)
        compiled(FULL, integrator="ao")
        os._exit(0)
    compiled(FULL)
    compiled(MEDIA)
    compiled(FULL, sampling="light")
    compiled(FULL, integrator="whitted")
    os.waitpid(child, 0)


if __name__ == "__main__":
    main()
