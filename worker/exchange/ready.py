"""Makes a kernel ready: downloads it if the farm has it; otherwise compiles it and uploads it to the farm."""

from __future__ import annotations

import contextlib
import gc
import logging
from collections.abc import Iterator

from renderer import jit
from renderer.parallel_compile import Helpers
from renderer.render import PLAIN, kernel_name, warm_up
from renderer.settings import RenderSettings
from worker.exchange.kernels import fetch_kernel, upload_kernel_in_background
from worker.exchange.link import Link

__all__ = ["fetch_or_compile", "make_kernel_ready"]

_log = logging.getLogger("worker")


def make_kernel_ready(
    link: Link, settings: RenderSettings | None = None, variant: str = PLAIN, helpers: Helpers | None = None
) -> None:
    """Makes a kernel ready: downloads it from the farm if possible; otherwise compiles it, and uploads it in the background.

    variant: which scene features it supports. helpers: processes that compile parts of it in parallel.
    """
    if not fetch_or_compile(link, settings, variant, helpers):
        upload_kernel_in_background(link, jit.cache_folder(), kernel_name(settings, variant))


def fetch_or_compile(
    link: Link, settings: RenderSettings | None = None, variant: str = PLAIN, helpers: Helpers | None = None
) -> bool:
    """Downloads a kernel from the farm, or else compiles it; does not upload it. Returns whether the farm had the kernel.

    Parameters as for `make_kernel_ready`.
    """
    folder = jit.cache_folder()
    farm_has_it = False

    def fetch(kernel: str) -> None:
        nonlocal farm_has_it
        farm_has_it, sentence = fetch_kernel(link, folder, kernel)
        _log.info(sentence)

    with _without_garbage_collection():
        took = warm_up(settings, variant, fetch, helpers)
    _log.info("kernel %s ready after %.1f s", kernel_name(settings, variant), took)
    return farm_has_it


@contextlib.contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Context manager that disables Python's garbage collector, which would take a fifth of the time of compiling a kernel."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
