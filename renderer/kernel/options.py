"""The settings that a sample's colour depends on, besides view and environment, as the kernel reads them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.settings import FILTERS, SAMPLERS, RenderSettings

__all__ = ["Options", "kernel_options"]


class Options(NamedTuple):
    """Numbers where the settings have names: their places in the tuples of renderer/settings.py."""

    seed: np.uint32
    sampler: np.int32
    filter: np.int32
    max_depth: int  # segments
    scale: np.float32  # 2**film_exponent


def kernel_options(settings: RenderSettings) -> Options:
    """The settings for the kernel."""
    return Options(
        seed=np.uint32(settings.seed),
        sampler=np.int32(SAMPLERS.index(settings.sampler)),
        filter=np.int32(FILTERS.index(settings.filter)),
        max_depth=2 if settings.integrator == "direct" and settings.max_depth > 2 else settings.max_depth,
        scale=np.float32(2.0**settings.film_exponent),
    )
