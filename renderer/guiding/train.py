"""Trains the guide of an image from pilot paths: a function of the compiled scene and the settings, the same on every host.

Each round follows more paths than the one before, with the guide made from all records so far.
"""

from __future__ import annotations

import threading
import weakref
from dataclasses import replace
from typing import Any

import numpy as np

from renderer.arrays.guide import Guide, empty_guide
from renderer.arrays.scene import CompiledScene, flat
from renderer.bvh.traverse import new_stack
from renderer.guiding.emitters import emitters_of
from renderer.guiding.histograms import guide_of
from renderer.guiding.shares import learn_shares
from renderer.kernel.camera import camera_frame
from renderer.kernel.guiding.photons import Photons, follow_photons
from renderer.kernel.guiding.pilot import MOST_ROWS, RECORD_COLUMNS, Pilot, follow_pilot_paths
from renderer.kernel.options import kernel_options
from renderer.kernel.path_trace import COLUMNS
from renderer.reference import Packed
from renderer.scene.origin import settings_relative_to_origin
from renderer.settings import RenderSettings

__all__ = ["train_guide", "warm_up_pilot", "with_guide"]

ROUNDS = (1 << 15, 1 << 16, 1 << 17)  # camera paths
PHOTONS = 1 << 18
# Fraction of the second moments. If more is left, `auto` renders without a guide, and `on` learns the share of each cell. If less
# is left, a share of a half everywhere is better: there are too few pilot paths to estimate the shares of single cells.
MOST_LEFT = 0.4
_RECORDS = 12  # at most, a path, on average
_OTHER_SEED = 0x9E3779B9  # pilot paths must be independent of the film's
_MOST_KEPT = 4
_kept: list[tuple[list[weakref.ref[Any]], RenderSettings, Guide]] = []
_lock = threading.Lock()


def train_guide(scene: CompiledScene, settings: RenderSettings) -> Guide:
    """Returns the guide of an image: of ROUNDS camera paths and PHOTONS photons.

    scene: stripped of absent features, without groups; not of the plain variant.
    """
    return _train(scene, settings, ROUNDS, PHOTONS)


def _train(scene: CompiledScene, settings: RenderSettings, rounds: tuple[int, ...], photons: int) -> Guide:
    seed = settings.seed ^ _OTHER_SEED
    settings = replace(settings, light_groups="", light_paths="off", cryptomatte=0, deep=0, background="visible")
    settings = replace(settings, seed=seed, sampler="independent", splitting=1)
    options = kernel_options(settings, scene)
    camera = camera_frame(settings_relative_to_origin(settings, scene.origin))
    log, stack = np.zeros((MOST_ROWS, COLUMNS)), new_stack()
    guide, emitters = empty_guide(), emitters_of(scene)
    scene = scene._replace(path_guide=guide)
    photons = photons if len(emitters.table) else 0
    flux = emitters.power / max(photons, 1)
    of_photons = np.zeros((photons * _RECORDS, RECORD_COLUMNS), np.float32)
    of_photons = of_photons[
        : follow_photons(Packed(scene), stack, options, Photons(0, photons, emitters.table, emitters.cdf), log, of_photons)
    ]
    records = np.zeros((sum(rounds) * _RECORDS, RECORD_COLUMNS), np.float32)
    first, found = photons, 0  # samples are numbered through, so that all paths are independent
    for number, count in enumerate(rounds):
        pilot, known = Pilot(first, count, settings.width, settings.height), found
        found += follow_pilot_paths(Packed(scene), stack, camera, options, pilot, log, records[found:])
        first, earlier, guide = first + count, guide, guide_of(records[:found], of_photons, flux)
        if number > 0:
            learned, left = learn_shares(guide, earlier, records[known:found])
            if left > MOST_LEFT:
                if settings.guiding == "auto":
                    return empty_guide()
                guide = learned
        scene = scene._replace(path_guide=guide)
    return guide


def with_guide(
    stored: CompiledScene, prepared: CompiledScene, for_pilot: CompiledScene, settings: RenderSettings
) -> CompiledScene:
    """Returns the scene `prepared` with the guide of an image.

    stored: the scene from which `prepared` was made for these settings, whose arrays are the same in each call. for_pilot: made
    from it in the form that `train_guide` expects. The guides of the last images are kept, since each batch needs its image's.
    """
    arrays = list(flat(stored).values())
    with _lock:
        for references, of, guide in _kept:
            if of == settings and all(each() is array for each, array in zip(references, arrays, strict=True)):
                return prepared._replace(path_guide=guide)
        guide = train_guide(for_pilot, settings)
        _kept[:] = [*_kept[1 - _MOST_KEPT :], ([*map(weakref.ref, arrays)], settings, guide)]
    return prepared._replace(path_guide=guide)


def warm_up_pilot(scene: CompiledScene, settings: RenderSettings) -> None:
    """Compiles or loads the kernel of pilot paths. scene: an empty one, as `train_guide` expects it."""
    _train(scene, settings, (0,), 0)
