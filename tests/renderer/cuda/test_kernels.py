"""Tests that the kernels for graphics cards render films that are bit-identical to the CPU kernel's.

The LLVM code that becomes PTX is run on the CPU.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from renderer.arrays.scene import CompiledScene
from renderer.bvh.compress import compressed
from renderer.cuda.job import wave_for
from renderer.cuda.turns import paths_for, take_turns
from renderer.film import CHANNELS, COLOR, group_planes
from renderer.kernel.accumulate import Batch
from renderer.kernel.backends.cuda.wavefront import ACTIVE, BAD, RAYS, Wave
from renderer.kernel.camera import Camera, camera_frame
from renderer.kernel.options import Options, kernel_options
from renderer.reference import packed
from renderer.render import RenderStats, _prepared, render_frame, variant_for
from renderer.scene.description import Material
from renderer.scene.origin import fixed_point_origin, settings_relative_to_origin
from renderer.settings import RenderSettings
from renderer.threads import Team
from renderer.variant_names import variant_suffix
from tests.grids import grid
from tests.renderer.builders import gray
from tests.renderer.cuda.on_host import launcher
from tests.renderer.kernel.backends.features import CAUSTICS, FEATURES, GROUPS, SPECTRAL, grouped, made
from tests.renderer.test_transparent_background import FLOOR, over_a_floor, transparent

SPP = 4
ORDINARY = ("diffuse", "glass", "metal and plastic", "no triangles", "a sky's picture", "a lens")


Picture = tuple[CompiledScene, Camera, Options, Batch, int, int]


def picture_of(name: str, first: int = 0, count: int = SPP) -> Picture:
    """Returns samples of a feature's picture, as the first arguments of `wave_for`."""
    scene, settings = made(name)
    prepared = _prepared(scene, settings)
    camera, options = camera_frame(settings_relative_to_origin(settings, prepared.origin)), kernel_options(settings, prepared)
    batch = Batch(0, 0, first, count, fixed_point_origin(prepared.origin, settings.film_exponent))
    with Team(1) as team:
        on_card = prepared._replace(bvh=compressed(prepared.bvh, team))
    return on_card, camera, options, batch, settings.width, settings.height


def variant_of(name: str) -> str:
    scene, settings = made(name)
    return f"{variant_for(settings, scene)}{variant_suffix(settings)}"


def bytes_of(wave: Wave) -> npt.NDArray[np.uint8]:
    return np.frombuffer(packed(wave, lambda array: array.ctypes.data), np.uint8).copy()


def run_wave(variant: str, wave: Wave) -> int:
    """Runs the kernels of a variant, which add the wave's samples to the wave's film; returns how many were launched."""
    data = [bytes_of(wave._replace(second=np.bool_(second))) for second in (False, True)]
    launched: list[str] = []

    def launch(kernel: str, threads: int, second: bool) -> None:
        launched.append(kernel)
        launcher(variant, kernel)(data[second].ctypes.data, threads)

    take_turns(launch, lambda: int(wave.lengths[ACTIVE]), wave.scene, wave.options, len(wave.branches))
    return len(launched)


def run(name: str, paths: int = 96) -> Wave:
    """Renders a feature's picture with the kernels of its variant, with `paths` - 1 paths at once."""
    wave = wave_for(*picture_of(name), paths=paths)
    run_wave(variant_of(name), wave)
    return wave


def of_cpu(name: str) -> tuple[npt.NDArray[np.int64], RenderStats]:
    stats = RenderStats()
    return render_frame(*made(name), SPP, stats=stats), stats


@grid("name", FEATURES, ordinary=ORDINARY)
def test_gpu_kernel_film_equals_the_cpu_film(name: str) -> None:
    wave = run(name)
    film, stats = of_cpu(name)
    assert (wave.film != film).any(0).sum() == 0
    assert wave.counters[RAYS] == stats.rays
    assert wave.counters[BAD] == 0


@pytest.mark.long
@pytest.mark.parametrize("name", SPECTRAL)
def test_film_by_wavelength_equals_the_cpu_film(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled, settings = FEATURES[name]
    monkeypatch.setitem(FEATURES, name, (compiled, replace(settings, spectral="on")))
    wave = run(name)
    film, stats = of_cpu(name)
    assert (wave.film != film).any(0).sum() == 0
    assert wave.counters[RAYS] == stats.rays
    assert wave.counters[BAD] == 0


@pytest.mark.long
@pytest.mark.parametrize("name", CAUSTICS)
def test_light_through_casters_has_the_same_bits(name: str) -> None:
    wave = run(name)
    film, stats = of_cpu(name)
    assert (wave.film == film).all()
    assert wave.counters[RAYS] == stats.rays
    assert wave.counters[BAD] == 0


def test_transparent_background_has_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    feature, (scene, settings) = "a transparent background", made("diffuse")
    monkeypatch.setitem(FEATURES, feature, (lambda: scene, replace(settings, background="transparent")))
    film, _ = of_cpu(feature)
    assert film[CHANNELS].any()
    assert (run(feature).film == film).all()


@pytest.mark.long  # compiles the kernel for lights without a body
def test_holdouts_and_shadow_catchers_have_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    feature, settings = "mattes", transparent(RenderSettings(24, 16, FLOOR))
    scene = over_a_floor(Material(base_color=gray(0.7), shadow_catcher=True), Material(base_color=gray(0.5), holdout=True))
    monkeypatch.setitem(FEATURES, feature, (lambda: scene, settings))
    film, _ = of_cpu(feature)
    assert film[CHANNELS + 1].any()
    assert (run(feature).film == film).all()


@pytest.mark.long  # compiles the kernels with light groups and light paths
@pytest.mark.parametrize(
    ("name", "asked"),
    (
        ("diffuse", {"light_groups": ",".join(GROUPS), "light_paths": "on"}),
        ("glass", {"light_groups": "sky", "light_paths": "on", "splitting": 1}),
        ("a clamp", {"light_groups": ",".join(GROUPS), "light_paths": "on", "background": "transparent"}),
        ("textures", {"light_groups": ",".join(GROUPS), "light_paths": "on"}),
        ("half clear lights", {"light_groups": ",".join(GROUPS), "light_paths": "on"}),
        ("unlit", {"light_groups": ",".join(GROUPS), "light_paths": "on"}),
        ("many lights", {"light_groups": ",".join(GROUPS), "light_paths": "on", "cryptomatte": 2}),
        ("lights without a body", {"light_groups": ",".join(GROUPS)}),
        ("lights with pictures", {"light_groups": "sun-1,key"}),
        ("what the camera does not see", {"light_paths": "on"}),
        ("skin", {"light_groups": "sky", "light_paths": "on", "spectral": "on"}),
        ("skin", {"light_groups": ",".join(GROUPS), "light_paths": "on"}),
        ("fire in a grid behind cards", {"light_groups": ",".join(GROUPS), "light_paths": "on"}),
        ("reflections in fog", {"light_groups": ",".join(GROUPS), "light_paths": "on"}),
    ),
)
def test_light_groups_and_paths_have_the_same_bits(name: str, asked: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    feature, settings = "light planes", replace(made(name)[1], **asked)
    monkeypatch.setitem(FEATURES, feature, (lambda: grouped(name), settings))
    wave, (film, stats) = run(feature), of_cpu(feature)
    assert (wave.film == film).all()
    assert wave.counters[RAYS] == stats.rays
    first = 0
    for planes in (len(settings.group_names), len(settings.light_planes) - len(settings.group_names)):
        found = [wave.film[group_planes(first + k)] for k in range(planes)]
        assert not found or (sum(found) == wave.film[COLOR]).all()
        assert not found or sum(each.any() for each in found) > 1
        first += planes


@pytest.mark.parametrize("paths", (32, 8192))
def test_number_of_paths_under_way_has_no_effect(paths: int) -> None:
    assert (run("diffuse", paths).film == of_cpu("diffuse")[0]).all()


def test_kernels_add_to_an_existing_film() -> None:
    first, rest = picture_of("diffuse", count=1), picture_of("diffuse", first=1, count=SPP - 1)
    wave = wave_for(*first, paths=64)
    run_wave("plain", wave)
    run_wave("plain", wave_for(*rest, paths=64)._replace(film=wave.film))
    assert (wave.film == of_cpu("diffuse")[0]).all()


def test_paths_of_a_batch_fit_into_the_memory() -> None:
    assert paths_for(100, 1 << 33, 1000) == 128
    assert paths_for(1 << 30, 1 << 40, 1000) == (1 << 20) + 32
    few = paths_for(1 << 30, 1 << 27, 1000)
    assert (1 << 27) / 5 < few * 1000 < (1 << 27) / 3
    assert few % 32 == 0
