"""Makes a kernel ready: downloads it if the farm has it; otherwise compiles it and uploads it to the farm."""

from __future__ import annotations

import contextlib
import gc
import logging
from collections.abc import Callable, Iterator
from functools import partial

from renderer import jit
from renderer.kernel.accumulate import samples_guide
from renderer.render import PLAIN, kernel_name, pilot_kernel_name, warm_up, warm_up_pilot
from renderer.settings import RenderSettings
from renderer.shipped_kernels import copy_shipped_kernels
from worker.exchange.kernels import fetch_kernel, upload_kernel_in_background
from worker.exchange.link import Link

__all__ = [
    "fetch_or_compile",
    "has_kernels",
    "load_or_fetch_kernel",
    "make_kernel_ready",
    "make_pilot_ready",
    "pilot_readiness",
]

_log = logging.getLogger("worker")


def load_or_fetch_kernel(link: Link) -> bool:
    """Loads the plain kernel from the cache or from the farm. Returns False if neither has it, so that it must be compiled."""
    if jit.is_cached(kernel_name()):
        make_kernel_ready(link)
        return True
    is_fetched, sentence = fetch_kernel(link, jit.cache_folder(), kernel_name())
    _log.info(sentence)
    if is_fetched:
        fetch_or_compile(link)
    return is_fetched


def has_kernels(link: Link, settings: RenderSettings, variant: str) -> bool:
    """Returns True if nothing has to be compiled to render with these settings and this variant.

    Downloads the kernels that the farm has and this machine lacks.
    """
    names = [kernel_name(settings, variant), *([pilot_kernel_name(variant)] if samples_guide(settings) else [])]
    folder = jit.cache_folder()
    if not all(map(jit.is_cached, names)):
        copy_shipped_kernels(folder)
    return all(jit.is_cached(name) or fetch_kernel(link, folder, name)[0] for name in names)


def make_kernel_ready(link: Link, settings: RenderSettings | None = None, variant: str = PLAIN) -> None:
    """Makes a kernel ready: downloads it from the farm if possible; otherwise compiles it, and uploads it in the background.

    variant: which scene features it supports.
    """
    if not fetch_or_compile(link, settings, variant):
        upload_kernel_in_background(link, jit.cache_folder(), kernel_name(settings, variant))


def fetch_or_compile(link: Link, settings: RenderSettings | None = None, variant: str = PLAIN) -> bool:
    """Downloads a kernel from the farm, or else compiles it; does not upload it. Returns whether the farm had the kernel.

    Parameters as for `make_kernel_ready`.
    """
    return _fetch_or_compile(link, kernel_name(settings, variant), lambda fetch: warm_up(settings, variant, fetch))


def make_pilot_ready(link: Link, settings: RenderSettings, variant: str) -> None:
    """Makes the kernel of pilot paths ready, as `make_kernel_ready` does. variant: of the kernel for images."""
    name = pilot_kernel_name(variant)
    if not _fetch_or_compile(link, name, partial(warm_up_pilot, settings, variant)):
        upload_kernel_in_background(link, jit.cache_folder(), name)


def pilot_readiness(link: Link, compiling: Callable[[bool], None]) -> Callable[[RenderSettings, str], None]:
    """Returns `make_pilot_ready` for this farm. compiling: called with True before it, and with False afterwards."""

    def prepare(settings: RenderSettings, variant: str) -> None:
        compiling(True)
        make_pilot_ready(link, settings, variant)
        compiling(False)

    return prepare


def _fetch_or_compile(link: Link, name: str, warm_up: Callable[[Callable[[str], None]], float]) -> bool:
    """Makes the kernel of this name ready. Returns whether the farm had it.

    warm_up: compiles or loads it, and returns the seconds taken; its argument downloads the kernel of a name.
    """
    folder = jit.cache_folder()
    farm_has_it = False

    def fetch(kernel: str) -> None:
        nonlocal farm_has_it
        farm_has_it, sentence = fetch_kernel(link, folder, kernel)
        _log.info(sentence)

    with _without_garbage_collection():
        took = warm_up(fetch)
    _log.info("kernel %s ready after %.1f s", name, took)
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
