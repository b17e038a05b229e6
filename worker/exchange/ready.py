"""Makes a kernel ready: downloaded if the farm has it, otherwise compiled and uploaded to the farm."""

from __future__ import annotations

import logging

from renderer import jit
from renderer.render import PLAIN, kernel_name, warm_up
from renderer.settings import RenderSettings
from worker.exchange.kernels import fetch_kernel, hand_in_beside
from worker.exchange.link import Link

__all__ = ["get_ready"]

_log = logging.getLogger("worker")


def get_ready(link: Link, settings: RenderSettings | None = None, edition: str = PLAIN) -> None:
    """As `warm_up`, with the farm's help."""
    folder = jit.cache_folder()
    farm_has_it = False

    def fetch(kernel: str) -> None:
        nonlocal farm_has_it
        farm_has_it, sentence = fetch_kernel(link, folder, kernel)
        _log.info(sentence)

    took = warm_up(settings, edition, fetch)
    kernel = kernel_name(settings, edition)
    _log.info("kernel %s ready after %.1f s", kernel, took)
    if not farm_has_it:
        hand_in_beside(link, folder, kernel)
