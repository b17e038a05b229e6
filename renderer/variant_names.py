"""The names of kernels for scenes and settings: a variant's, and suffixes for what the settings add to it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

from renderer.arrays.guide import empty_guide
from renderer.arrays.kernel_variant import strip_absent_features
from renderer.arrays.scene import CompiledScene, example
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.arrays.spectrum import empty_spectrum_tables
from renderer.errors import SettingsError
from renderer.kernel.accumulate import samples_caustics, samples_guide
from renderer.scene.caustics import example_tables
from renderer.scene.light_groups import with_group_planes
from renderer.settings import RenderSettings, View

__all__ = [
    "CAUSTICS_SUFFIX",
    "GUIDED_SUFFIX",
    "SPECTRAL_SUFFIX",
    "base_variant",
    "example_of",
    "has_caustics",
    "kernel_names",
    "suffixes_of",
    "variant_suffix",
]

CAUSTICS_SUFFIX = "-caustics"  # of a variant's name: for settings that sample light through casters,
GUIDED_SUFFIX = "-guided"  # then with a path guide,
_PATHS_SUFFIX = "-paths"  # then with light paths,
_GROUPS_SUFFIX = "-groups"  # with light groups,
SPECTRAL_SUFFIX = "-spectral"  # and at the end for spectra
_IN_ORDER = CAUSTICS_SUFFIX, GUIDED_SUFFIX, _PATHS_SUFFIX, _GROUPS_SUFFIX, SPECTRAL_SUFFIX
_WITHOUT_PLAIN = CAUSTICS_SUFFIX, SPECTRAL_SUFFIX  # what the first variant has no kernels for (`renderer.render.variant_for`)
_VALUES: dict[str, tuple[Any, ...]] = {  # of the settings that add suffixes
    "caustics": ("off", "on"),
    "guiding": ("off", "on"),
    "light_paths": ("off", "on"),
    "light_groups": ("", "a"),
    "spectral": ("off", "on"),
}
_PICTURE = RenderSettings(2, 2, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))


def variant_suffix(settings: RenderSettings) -> str:
    """Returns what is appended to a variant's name for what these settings add to its kernel."""
    sampled = f"{CAUSTICS_SUFFIX if samples_caustics(settings) else ''}{GUIDED_SUFFIX if samples_guide(settings) else ''}"
    by_light = f"{_PATHS_SUFFIX if settings.has_light_paths else ''}{_GROUPS_SUFFIX if settings.light_groups else ''}"
    return f"{sampled}{by_light}{SPECTRAL_SUFFIX if settings.is_spectral else ''}"


def kernel_names() -> list[str]:
    """Returns the names of the kernels that scenes and settings can request: each variant's with all that settings add to it."""
    suffixes: list[str] = []
    for values in itertools.product(*_VALUES.values()):
        try:
            suffixes.append(variant_suffix(replace(_PICTURE, **dict(zip(_VALUES, values, strict=True)))))
        except SettingsError:  # that cannot be combined
            continue
    plain, *others = KERNEL_VARIANTS
    with_plain = [suffix for suffix in suffixes if not set(_WITHOUT_PLAIN) & suffixes_of(f"{plain}{suffix}")]
    return [*(f"{plain}{suffix}" for suffix in with_plain), *(f"{name}{suffix}" for name in others for suffix in suffixes)]


def base_variant(name: str) -> str:
    """Returns the kernel variant (renderer/arrays/scene_features.py) of a name with `variant_suffix`."""
    return _split(name)[0]


def suffixes_of(name: str) -> set[str]:
    """Returns the suffixes of a name with `variant_suffix`."""
    return set(_split(name)[1])


def has_caustics(name: str) -> bool:
    """Returns True if the kernel of that name samples light through casters."""
    return CAUSTICS_SUFFIX in _split(name)[1]


def example_of(name: str) -> tuple[CompiledScene, RenderSettings]:
    """Returns (a scene of no size, settings) for which the kernel of that name is compiled.

    name: of a variant, with `variant_suffix` of settings.
    """
    variant, suffixes = _split(name)
    has_groups, has_paths = _GROUPS_SUFFIX in suffixes, _PATHS_SUFFIX in suffixes
    settings = replace(
        _PICTURE,
        light_groups="a" if has_groups else "",
        light_paths="on" if has_paths else "off",
        spectral="on" if SPECTRAL_SUFFIX in suffixes else "off",
        caustics="on" if CAUSTICS_SUFFIX in suffixes else "off",
        guiding="on" if GUIDED_SUFFIX in suffixes else "off",
    )
    nothing = strip_absent_features(with_group_planes(example(), settings.group_names), variant, has_groups, has_paths)
    if GUIDED_SUFFIX in suffixes:
        nothing = nothing._replace(path_guide=empty_guide())
    if CAUSTICS_SUFFIX in suffixes:
        nothing = nothing._replace(caustics=example_tables())
    if SPECTRAL_SUFFIX in suffixes:
        nothing = nothing._replace(spectrum=empty_spectrum_tables())
    return nothing, settings


def _split(name: str) -> tuple[str, list[str]]:
    """Returns (the variant, the suffixes) of a name."""
    suffixes = []
    for suffix in reversed(_IN_ORDER):
        if name.endswith(suffix):
            name = name.removesuffix(suffix)
            suffixes.append(suffix)
    return name, suffixes
