"""Trains the guide of an image from pilot paths: a function of the compiled scene and the settings, the same on every host.

The first LOOK paths measure how often light samples find light. In a scene lit that way portals are of no use, and `auto` renders
without a guide; a part of them suffices where that is clear. Otherwise portals are learned in two rounds of paths, the second
guided by the portals of the first. They are the guide if they reduce the second moments of further paths enough; if not, it is
one of histograms, of three rounds and photons.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from renderer.arrays.guide import Guide, empty_guide
from renderer.arrays.rows import CONDUCTOR, GLASS, MIRROR
from renderer.arrays.scene import CompiledScene, flat
from renderer.bvh.traverse import new_stack
from renderer.guiding.emitters import Emitters, emitters_of
from renderer.guiding.histograms import Records, guide_of
from renderer.guiding.portals import learn_portals, lit_part, moment_left, segments_of
from renderer.guiding.shares import learn_shares
from renderer.guiding.stored_guide import is_of_use
from renderer.kernel.camera import camera_frame
from renderer.kernel.guiding.photons import Photons, follow_photons
from renderer.kernel.guiding.pilot import MOST_ROWS, RECORD_COLUMNS, Pilot, follow_pilot_paths
from renderer.kernel.options import kernel_options
from renderer.kernel.path_trace import COLUMNS
from renderer.reference import Packed
from renderer.scene.origin import settings_relative_to_origin
from renderer.settings import RenderSettings

__all__ = ["is_guide_kept", "keep_guide", "kept_guide", "load_pilot_kernel", "train_guide"]

ROUNDS = (1 << 16, 1 << 16, 1 << 17)  # camera paths of a guide of histograms
PORTAL_ROUNDS = (1 << 15, 1 << 16, 1 << 13)  # of one of portals; the last round tests them
LOOK = 1 << 12  # of the first round, which test whether the scene is lit;
GLANCE = 1 << 10  # the first of these suffice where it clearly is
MOST_LIT = 0.25  # fraction of segments at whose end a light sample finds light; 0.02 behind a door that is ajar
CLEARLY = 0.1  # beyond MOST_LIT, several standard errors of the fraction after GLANCE paths
PHOTONS = 1 << 18
# Fraction of the second moments. If more is left, `auto` renders without a guide, and `on` learns the share of each cell. If less
# is left, a share of a half everywhere is better: there are too few pilot paths to estimate the shares of single cells.
MOST_LEFT = 0.4
MOST_LEFT_BY_PORTALS = 0.85  # likewise, of the second moments relative to their cube's light, for a guide of portals
ERRORS = 2.0  # standard errors of that fraction by which it must stay below for `auto`
_FOCUSING = (MIRROR, GLASS, CONDUCTOR)  # materials without which `auto` does not try histograms, which pay for caustics alone
_RECORDS = 12  # at most, a path, on average
_OTHER_SEED = 0x9E3779B9  # pilot paths must be independent of the film's
_MOST_KEPT = 4
_kept: list[tuple[list[weakref.ref[Any]], RenderSettings, Guide | None]] = []  # of the last images: arrays, key, guide
_lock = threading.Lock()


def train_guide(scene: CompiledScene, settings: RenderSettings) -> Guide | None:
    """Returns the guide of an image; None if paths follow no guide, with or without which the film has the same bits.

    scene: stripped of absent features, without groups; not of the plain variant.
    """
    guide = _train(scene, _pilot_settings(settings), ROUNDS, PHOTONS)
    return guide if is_of_use(guide) else None


def _pilot_settings(settings: RenderSettings) -> RenderSettings:
    """Returns the settings of pilot paths."""
    settings = replace(settings, light_groups="", light_paths="off", cryptomatte=0, deep=0, background="visible")
    return replace(settings, seed=settings.seed ^ _OTHER_SEED, sampler="independent", splitting=1)


def _key(settings: RenderSettings) -> RenderSettings:
    """Returns the settings on which an image's guide depends: with the background, which decides how catchers find the sky."""
    return replace(_pilot_settings(settings), background=settings.background)


def _train(scene: CompiledScene, settings: RenderSettings, rounds: tuple[int, ...], photons: int) -> Guide:
    """Returns the guide of an image; an empty one if it is refused. settings: of pilot paths."""
    emitters = emitters_of(scene)
    photons = photons if len(emitters.table) else 0
    pilot = _PilotPaths(scene, settings, photons)  # samples are numbered through, so that all paths are independent
    first = pilot.follow(min(GLANCE, rounds[0]), empty_guide())
    if settings.guiding == "auto" and lit_part(first) > MOST_LIT + CLEARLY:
        return empty_guide()
    first = np.concatenate((first, pilot.follow(max(min(LOOK, rounds[0]) - GLANCE, 0), empty_guide())))
    is_lit = lit_part(first) > MOST_LIT
    if is_lit and settings.guiding == "auto":
        return empty_guide()
    if not is_lit and rounds[0]:
        first = np.concatenate((first, pilot.follow(max(PORTAL_ROUNDS[0] - LOOK, 0), empty_guide())))
        guide = _portals(pilot, first, ERRORS if settings.guiding == "auto" else 0.0)
        if guide is not None:
            return guide
    if settings.guiding == "auto" and not np.isin(scene.material_kind, _FOCUSING).any():
        return empty_guide()
    first = np.concatenate((first, pilot.follow(max(rounds[0] - (LOOK if is_lit else PORTAL_ROUNDS[0]), 0), empty_guide())))
    of_photons = pilot.follow_photons(emitters, photons)
    return _histograms(pilot, first, of_photons, emitters.power / max(photons, 1), rounds[1:], settings.guiding == "auto")


class _PilotPaths:
    """Follows the pilot paths of an image. first: the number of the first path."""

    def __init__(self, scene: CompiledScene, settings: RenderSettings, first: int) -> None:
        self._scene, self._settings, self._first = scene, settings, first
        self._options = kernel_options(settings, scene)
        self._camera = camera_frame(settings_relative_to_origin(settings, scene.origin))
        self._log, self._stack = np.zeros((MOST_ROWS, COLUMNS)), new_stack()

    def follow(self, count: int, guide: Guide) -> Records:
        """Returns the records of the next `count` paths, which follow a guide."""
        scene, records = self._scene._replace(path_guide=guide), np.zeros((count * _RECORDS, RECORD_COLUMNS), np.float32)
        pilot = Pilot(self._first, count, self._settings.width, self._settings.height)
        self._first += count
        return records[: follow_pilot_paths(Packed(scene), self._stack, self._camera, self._options, pilot, self._log, records)]

    def follow_photons(self, emitters: Emitters, count: int) -> Records:
        """Returns the records of photons, whose numbers are below those of all paths."""
        scene, records = self._scene._replace(path_guide=empty_guide()), np.zeros((count * _RECORDS, RECORD_COLUMNS), np.float32)
        photons = Photons(0, count, emitters.table, emitters.cdf)
        return records[: follow_photons(Packed(scene), self._stack, self._options, photons, self._log, records)]


def _portals(pilot: _PilotPaths, first: Records, errors: float) -> Guide | None:
    """Returns a guide of portals; None if it saves too little.

    first: the records of unguided paths. errors: by how many standard errors it must save enough.
    """
    learned = learn_portals(segments_of(first)) if len(first) else None
    if learned is None:
        return None
    guide = learn_portals(segments_of(np.concatenate((first, pilot.follow(PORTAL_ROUNDS[1], learned)))))
    others = pilot.follow(PORTAL_ROUNDS[2], learned)
    if guide is None or not len(others):
        return None
    left, error = moment_left(guide, segments_of(others))
    return guide if left + errors * error < MOST_LEFT_BY_PORTALS else None


def _histograms(
    pilot: _PilotPaths, records: Records, photons: Records, flux: float, rounds: tuple[int, ...], may_refuse: bool
) -> Guide:
    """Returns a guide of histograms; an empty one if it saves too little and may be refused.

    records: of the first round. photons, flux: as for `guide_of`. rounds: the others' numbers of paths.
    """
    guide = guide_of(records, photons, flux)
    for count in rounds:
        last, earlier = pilot.follow(count, guide), guide
        records = np.concatenate((records, last))
        guide = guide_of(records, photons, flux)
        learned, left = learn_shares(guide, earlier, last)
        if left > MOST_LEFT:
            if may_refuse:
                return empty_guide()
            guide = learned
    return guide


def kept_guide(stored: CompiledScene, settings: RenderSettings, train: Callable[[], Guide | None]) -> Guide | None:
    """Returns the guide of an image, which `train` returns, unless it is kept. Those of the last images are, for their batches.

    stored: the image's scene, whose arrays are the same in each call.
    """
    with _lock:
        found = _find_kept(stored, settings)
        return found[0] if found else _keep(stored, settings, train())


def keep_guide(stored: CompiledScene, settings: RenderSettings, guide: Guide | None) -> None:
    """Keeps a guide that another process has trained for an image; None if its paths follow no guide."""
    with _lock:
        if _find_kept(stored, settings) is None:
            _keep(stored, settings, guide)


def is_guide_kept(stored: CompiledScene, settings: RenderSettings) -> bool:
    """Returns True if `kept_guide` returns the guide of an image without training it."""
    with _lock:
        return _find_kept(stored, settings) is not None


def _find_kept(stored: CompiledScene, settings: RenderSettings) -> tuple[Guide | None] | None:
    """Returns (the guide of an image), if it is kept."""
    arrays, wanted = list(flat(stored).values()), _key(settings)
    for references, of, guide in _kept:
        if of == wanted and all(each() is array for each, array in zip(references, arrays, strict=True)):
            return (guide,)
    return None


def _keep(stored: CompiledScene, settings: RenderSettings, guide: Guide | None) -> Guide | None:
    references = [weakref.ref(array) for array in flat(stored).values()]
    _kept[:] = [*_kept[1 - _MOST_KEPT :], (references, _key(settings), guide)]
    return guide


def load_pilot_kernel(scene: CompiledScene, settings: RenderSettings) -> None:
    """Compiles or loads the kernel of pilot paths. scene: an empty one, as `train_guide` expects it."""
    _train(scene, _pilot_settings(settings), (0,), 0)
