"""Tests that the add-on reports an unsupported Cycles setting if, and only if, it changes the picture."""

from __future__ import annotations

import json
import subprocess
from types import SimpleNamespace
from typing import Any

import pytest

from blender.rayfarm_addon.scene import cycles
from renderer.settings import OPTIONAL
from tests.peers.blender import python_with_bpy

CYCLES = {
    "transmission_bounces": 12,
    "transparent_max_bounces": 8,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 10.0,
    "blur_glossy": 1.0,
    "caustics_reflective": True,
    "caustics_refractive": True,
    "use_fast_gi": False,
    "film_exposure": 1.0,
    "film_transparent_glass": False,
    "rolling_shutter_type": "NONE",
    "rolling_shutter_duration": 0.1,
    "texture_limit_render": "OFF",
    "use_camera_cull": False,
    "use_distance_cull": False,
    "diffuse_bounces": 4,
    "glossy_bounces": 4,
    "max_bounces": 12,
    "pixel_filter_type": "BLACKMAN_HARRIS",
    "filter_width": 1.5,
}
# Settings of Cycles that are supported; below, those that affect only the viewport, or the time, method or noise of rendering.
TAKEN = {"samples", "seed", "use_denoising", "use_adaptive_sampling", "adaptive_threshold"}
BUT_HOW = {
    *("device", "feature_set", "shading_system", "preview_pause", "denoiser", "use_sample_subset", "sample_offset"),
    *("sample_subset_length", "time_limit", "sampling_pattern", "scrambling_distance", "auto_scrambling_distance"),
    *("use_layer_samples", "light_sampling_threshold", "adaptive_min_samples", "direct_light_sampling_type", "use_light_tree"),
    *("min_light_bounces", "min_transparent_bounces", "surface_guiding_probability", "volume_guiding_probability"),
    *("use_animated_seed", "bake_type", "use_auto_tile", "tile_size", "texture_limit", "ao_bounces"),
    *("use_surface_guiding", "use_volume_guiding", "use_deterministic_guiding"),
}
WITH = {  # reported together with other settings or by their feature
    *("film_transparent_roughness", "camera_cull_margin", "distance_cull_margin"),
    *("fast_gi_method", "ao_bounces_render"),
    *("volume_bounces", "volume_step_rate", "volume_max_steps"),
    *("dicing_rate", "max_subdivisions", "dicing_camera", "offscreen_dicing_scale"),
}
KINDS = ("preview_", "denoising_", "debug_", "use_guiding", "guiding_", "use_preview_", "volume_preview_")


def scene(**changed: Any) -> tuple[Any, Any]:
    """Returns (scene, view layer) with Blender's default settings. changed: settings with other values, by name."""
    straight = SimpleNamespace(curves=[SimpleNamespace(points=[SimpleNamespace(location=(x, 1.0)) for x in (0.0, 1.0)])])
    render = {
        "engine": "CYCLES",
        "film_transparent": False,
        "use_multiview": False,
        "use_motion_blur": False,
        "use_simplify": False,
    }
    render |= {"motion_blur_shutter_curve": straight, "pixel_aspect_x": 1.0, "pixel_aspect_y": 1.0}
    layer = {"use_sky": True, "use_solid": True, "use_strand": True, "use_motion_blur": True, "aovs": [], "lightgroups": []}
    own = dict(CYCLES)
    for name, value in changed.items():
        owner = next(each for each in (own, layer if name.startswith("use_s") else render, render) if name in each)
        owner[name] = value
    found = SimpleNamespace(render=SimpleNamespace(**render), cycles=SimpleNamespace(**own, feature_set="SUPPORTED"))
    return found, SimpleNamespace(**layer)


def reported_settings(**changed: Any) -> list[str]:
    found: list[str] = []
    cycles.warn_of_settings(*scene(**changed), found.append, is_clamped=False, has_filter=False)
    return found


def test_default_scene_has_no_warnings() -> None:
    assert reported_settings() == []
    assert reported_settings(use_motion_blur=True, use_simplify=True) == []


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"transparent_max_bounces": 0}, "0 in Blender"),
        ({"sample_clamp_direct": 3.0}, "clamped at 3"),
        ({"sample_clamp_indirect": 2.0}, "clamped at 2"),
        ({"blur_glossy": 5.0}, "Filter Glossy is 5"),
        ({"caustics_reflective": False}, "reflective caustics"),
        ({"caustics_refractive": False}, "refractive caustics"),
        ({"use_fast_gi": True}, "Fast GI"),
        ({"film_exposure": 2.0}, "exposure of 2"),
        ({"film_transparent": True, "film_transparent_glass": True}, "Transparent Glass"),
        ({"use_multiview": True}, "Stereoscopy"),
        ({"pixel_filter_type": "GAUSSIAN"}, "Gaussian"),
        ({"filter_width": 4.0}, "4 wide"),
        ({"pixel_aspect_x": 2.0}, "pixel aspect"),
        ({"use_sky": False}, "Environment"),
        ({"use_solid": False}, "Surfaces"),
        ({"use_strand": False}, "Hair"),
        ({"use_simplify": True, "texture_limit_render": "512"}, "512 texels"),
        ({"use_simplify": True, "use_camera_cull": True}, "Camera Culling"),
        ({"use_simplify": True, "use_distance_cull": True}, "Distance Culling"),
    ],
)
def test_unsupported_setting_causes_one_warning(changed: dict[str, Any], word: str) -> None:
    (sentence,) = reported_settings(**changed)
    assert word in sentence


def test_bounce_limits_match_cycles() -> None:
    """Our depth limits are one more than Cycles' bounce limits, since Cycles lights the surface after the last bounce too."""

    def depths(**changed: Any) -> dict[str, int]:
        return cycles.depths_of(scene(**changed)[0])

    assert depths() == {"diffuse_depth": 5, "glossy_depth": 5, "transmission_depth": 13, "transparency_depth": 8}
    few = {"diffuse_bounces": 0, "glossy_bounces": 12, "transmission_bounces": 1024, "transparent_max_bounces": 0}
    assert depths(**few) == {"diffuse_depth": 1, "transmission_depth": 13, "transparency_depth": 1}
    assert depths(engine="BLENDER_EEVEE_NEXT") == {}
    most = depths(max_bounces=1024, transmission_bounces=1024, transparent_max_bounces=1024)
    assert (most["transmission_depth"], most["transparency_depth"]) == (1024, 1024)
    assert set(most) <= set(OPTIONAL)
    assert not reported_settings(diffuse_bounces=0, glossy_bounces=1, transmission_bounces=2, transparent_max_bounces=1)


def test_rolling_shutter_reads_out_while_rows_are_not_exposed() -> None:
    def share(**changed: Any) -> float:
        return cycles.rolling_shutter_of(scene(**changed)[0])

    assert share() == 0.0
    assert share(rolling_shutter_type="TOP") == 0.9
    assert share(rolling_shutter_type="TOP", rolling_shutter_duration=0.0) == 1.0
    assert share(rolling_shutter_type="TOP", rolling_shutter_duration=1.0) == 0.0
    assert share(rolling_shutter_type="TOP", engine="BLENDER_EEVEE_NEXT") == 0.0
    assert not reported_settings(use_motion_blur=True, rolling_shutter_type="TOP")


@pytest.mark.parametrize("engine", ["BLENDER_EEVEE_NEXT", "BLENDER_WORKBENCH"])
def test_cycles_settings_are_ignored_for_other_engines(engine: str) -> None:
    assert reported_settings(engine=engine, film_exposure=2.0, use_fast_gi=True) == []


def test_flags_of_many_objects_share_one_warning() -> None:
    found, layer = scene(use_motion_blur=True)
    flags = cycles.Flags(found, layer)
    for i in range(8):
        still = SimpleNamespace(use_motion_blur=False, use_deform_motion=True, use_adaptive_subdivision=True)
        flags.inspect(SimpleNamespace(name=f"thing {i // 2}", cycles=still))
    said: list[str] = []
    flags.warn_of_found(said.append)
    assert said == ["thing 0, thing 1, thing 2, thing 3: blurred as it moves, unlike in Blender"]


@pytest.mark.long
def test_every_cycles_setting_is_classified() -> None:
    """Every setting of Cycles, including those of later Blenders, is supported, reported, or known to be irrelevant."""
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    script = "import bpy, json; print(json.dumps([p.identifier for p in bpy.context.scene.cycles.bl_rna.properties]))"
    done = subprocess.run([str(python), "-c", script], capture_output=True, text=True, check=True)
    names = set(json.loads(done.stdout.splitlines()[-1])) - {"rna_type", "name"}
    known = set(CYCLES) | TAKEN | BUT_HOW | WITH
    assert {name for name in names - known if not name.startswith(KINDS)} == set()
