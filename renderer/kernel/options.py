"""The settings that affect a sample's colour, except view and environment, in the form that kernels read."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.arrays.rows import CATCHES, HOLDOUT, TRANSPARENT
from renderer.arrays.scene import CompiledScene
from renderer.kernel.light_paths import OTHER_ROWS
from renderer.settings import (
    FILTERS,
    HEURISTICS,
    MAX_CAUSTIC_TRIALS,
    MAX_DEPTH,
    MISTAKES,
    SAMPLERS,
    SAMPLINGS,
    SETTINGS,
    RenderSettings,
)

__all__ = [
    "ATTENUATION",
    "BALANCE",
    "BSDF",
    "LIGHT",
    "LIGHT_CUTOFF",
    "MIS",
    "MIXTURE",
    "NO_MISTAKE",
    "UNIFORM",
    "Options",
    "group_rows",
    "is_special",
    "kernel_options",
]

MIS, LIGHT, BSDF, UNIFORM, MIXTURE = (np.int32(SAMPLINGS.index(name)) for name in ("mis", "light", "bsdf", "uniform", "mixture"))
BALANCE = np.int32(HEURISTICS.index("balance"))
NO_MISTAKE, LIGHT_CUTOFF, ATTENUATION = (np.int32(MISTAKES.index(name)) for name in ("", "light-cutoff", "attenuation"))


class Options(NamedTuple):
    """The kernel's settings. Names of choices are replaced by their indices in the tuples of renderer/settings.py."""

    seed: np.uint32
    sampler: np.int32
    filter: np.int32
    sampling: np.int32
    heuristic: np.int32
    mistake: np.int32
    max_depth: int  # limit of counted segments
    diffuse_depth: np.float32  # bounces of that kind, after which a path ends at the next surface; infinite: no limit
    glossy_depth: np.float32
    transmission_limit: np.float32  # transmissions likewise
    transparency_depth: np.float32  # surfaces that a path passes by their alpha; infinite: no limit
    has_depths: bool  # whether any of these four is a limit
    transmission_depth: int  # upper bound of smooth transmissions, which do not count as segments; 0: they do
    light_samples: int
    caustic_trials: int  # greatest number of walks that estimate the probability of one (kernel/manifold/estimate.py)
    splitting: int  # number of branches into which a path's first vertex scatters it
    scale: np.float32  # 2**film_exponent
    clamp: np.float32  # 0: none
    roulette: np.float32  # 0: by throughput
    roulette_floor: np.float32
    ao_distance: np.float32  # infinite: no limit
    ambient: tuple[np.float32, np.float32, np.float32]
    transparent: bool  # whether any material in the scene transmits light by its alpha
    groups: np.uint32  # number of light groups with planes in the film; 0: none
    paths: np.uint32  # number of light paths with planes in the film, or 0
    group_rows: np.uint32  # of the table of light_groups.py and light_paths.py for one branch of a path
    transparent_background: bool  # whether camera rays see no background, and the film has planes of alpha
    has_mattes: bool  # whether some materials before it are holdouts or catch shadows or reflections


def kernel_options(settings: RenderSettings, scene: CompiledScene) -> Options:
    """Returns the kernel's settings, including the properties of the whole scene that kernels need."""
    red, green, blue = settings.ambient
    limits = [_limit(settings, name) for name in ("diffuse_depth", "glossy_depth", "transmission_depth", "transparency_depth")]
    diffuse, glossy, transmission, transparency = limits
    return Options(
        seed=np.uint32(settings.seed),
        sampler=np.int32(SAMPLERS.index(settings.sampler)),
        filter=np.int32(FILTERS.index(settings.filter)),
        sampling=np.int32(SAMPLINGS.index(settings.sampling)),
        heuristic=np.int32(HEURISTICS.index(settings.heuristic)),
        mistake=np.int32(MISTAKES.index(settings.mistake)),
        max_depth=min(settings.max_depth, 2) if settings.integrator == "direct" else settings.max_depth,
        diffuse_depth=np.float32(diffuse),
        glossy_depth=np.float32(glossy),
        transmission_limit=np.float32(transmission),
        transparency_depth=np.float32(transparency),
        has_depths=min(limits) < math.inf,
        transmission_depth=settings.transmission_depth if settings.integrator == "path" else 0,
        light_samples=settings.light_samples,
        caustic_trials=MAX_CAUSTIC_TRIALS,
        splitting=settings.splitting if settings.sampling == "mis" else 1,  # other strategies are compared without splitting
        scale=np.float32(2.0**settings.film_exponent),
        clamp=np.float32(settings.clamp_indirect),
        roulette=np.float32(settings.roulette),
        roulette_floor=np.float32(settings.roulette_floor),
        ao_distance=np.float32(settings.ao_distance or np.inf),
        ambient=(np.float32(red), np.float32(green), np.float32(blue)),
        transparent=bool((scene.material_flags & TRANSPARENT).any()),
        groups=np.uint32(len(settings.group_names)),
        paths=np.uint32(len(settings.light_planes) - len(settings.group_names)),
        group_rows=np.uint32(group_rows(settings)),
        transparent_background=settings.is_transparent,
        has_mattes=settings.is_transparent and bool((scene.material_flags & (HOLDOUT | CATCHES)).any()),
    )


def group_rows(settings: RenderSettings) -> int:
    """Returns the rows of a branch in the table of its light by group and path: light_groups.py has one more, ChosenGroup."""
    return len(settings.group_names) + 1 + (OTHER_ROWS if settings.has_light_paths else 0) if settings.light_planes else 0


def _limit(settings: RenderSettings, name: str) -> float:
    """Returns the limit, called `name` in the settings, on one kind of bounce.

    It is infinite if switched off, or if the integrator ignores it. The largest transmission depth needs no counter: the upper
    bound of uncounted segments enforces it.
    """
    declared, value = SETTINGS[name], getattr(settings, name)
    is_read = not declared.shown.integrators or settings.integrator in declared.shown.integrators
    is_counted = name != "transmission_depth" or value < MAX_DEPTH
    return float(value) if is_read and is_counted and value != declared.setting.off else math.inf


def is_special(settings: RenderSettings) -> bool:
    """Returns True if the settings need the scalar path tracer of lineage/path.py.

    It is needed for alternative strategies to find light, deliberate errors, and several light samples per vertex.
    """
    plain = settings.sampling == "mis" and settings.heuristic == "power"
    return not plain or settings.mistake != "" or settings.light_samples > 1
