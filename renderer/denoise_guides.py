"""The albedo behind mirrors and smooth glass, a better guide for denoising than theirs.

A film's albedo is that of the first hit, which says nothing about what a mirror shows. Open Image Denoise advises to follow
reflections and refractions that are perfectly specular to the first surface that is not
(https://www.openimagedenoise.org/documentation.html, "Albedos"). Such an albedo is a picture of its own: that of the scene in
which these surfaces are as they are, and all others show their base colour without any light. It is rendered with a few
samples, and differs from the film's albedo only where such surfaces are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.arrays.scene import CompiledScene
from renderer.denoise import denoise
from renderer.film import ALBEDO, COLOR, NORMAL, Sums, mean
from renderer.kernel.accumulate import has_variants
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.render import render_frame
from renderer.settings import RenderSettings

__all__ = ["denoise_still", "guide_scene", "guiding_albedo"]

F32 = npt.NDArray[np.float32]

SAMPLES = 16  # per pixel; 64 reduced the denoised picture's error by 1 to 5 % more
_SMOOTH_METAL = 0.15  # greatest roughness of a metal in which objects are recognized
_METAL = 0.9  # least metallic
_UNSEEN_FLAGS = np.int32(rows.HOLDOUT | rows.CATCHES | rows.SCATTERS_WITHIN)


def guiding_albedo(scene: CompiledScene, settings: RenderSettings, albedo: F32, threads: int | None = None) -> F32:
    """Returns the albedo with which to guide the denoising of a whole frame, (h, w, 3) float32.

    albedo: that of the frame's film; it is returned itself if no surface is a mirror or smooth glass, if media scatter, or if the
    settings need a path tracer other than that of pictures. settings: of the frame. threads: None for all cores. The result
    depends on nothing else, and equals `albedo` in pixels in which none of SAMPLES samples meets such a surface.
    """
    shown = guide_scene(scene) if has_variants(settings) else None
    if shown is None or albedo.shape[:2] != (settings.height, settings.width):
        return albedo
    sums = render_frame(shown, _guide_settings(settings), SAMPLES, threads)
    exponent = settings.film_exponent
    return np.clip(albedo + (mean(sums, exponent) - mean(sums, exponent, ALBEDO)), 0, 1).astype(np.float32)


def denoise_still(sums: Sums, scene: CompiledScene, settings: RenderSettings, threads: int | None = None) -> F32:
    """Returns the denoised colour of a frame, (h, w, 3) float32, guided by `guiding_albedo`.

    sums: of the frame or a part of it, which is guided by the first hits alone. Raises SettingsError as `denoise` does.
    """
    color, albedo, normal = (mean(sums, settings.film_exponent, channel) for channel in (COLOR, ALBEDO, NORMAL))
    return denoise(color, guiding_albedo(scene, settings, albedo, threads), normal, threads)


def guide_scene(scene: CompiledScene) -> CompiledScene | None:
    """Returns the scene whose picture is the albedo behind specular surfaces; None if it has none, or if media scatter.

    Smooth metals are mirrors in it, and all that is not specular is unlit. No light is left, apart from the environment, which
    the settings replace.
    """
    kind, table = scene.material_kind.copy(), scene.material.copy()
    textured = scene.material_texture[:, rows.METALLIC_ROUGHNESS_TEXTURE] >= 0
    rough = table[:, rows.ROUGHNESS]
    metal = (kind == rows.METALLIC_ROUGHNESS) & (table[:, rows.METALLIC] >= _METAL) & (rough <= _SMOOTH_METAL) & ~textured
    specular = metal | (kind == rows.MIRROR) | ((kind == rows.CONDUCTOR) & (rough <= SMOOTH_GLASS))
    specular |= (kind == rows.GLASS) | ((scene.material_flags & rows.CLEAR) != 0)
    scatters = len(scene.volume) > 0 or bool(scene.medium[:, rows.SIGMA_S : rows.SIGMA_S + 3].any())
    if scatters or not specular.any():
        return None
    kind[metal] = rows.MIRROR
    kind[~specular & (kind != rows.INTERFACE)] = rows.UNLIT
    table[:, rows.EMISSION : rows.EMISSION + 3] = 0
    flags = scene.material_flags & ~_UNSEEN_FLAGS
    for array in (kind, table, flags):
        array.flags.writeable = False
    return scene._replace(material_kind=kind, material=table, material_flags=flags, sun=scene.sun[:0])


def _guide_settings(settings: RenderSettings) -> RenderSettings:
    """Returns the settings of the guide's picture: the view and sample numbers of the frame, without its light and planes."""
    return replace(
        settings,
        splitting=1,
        caustics="off",
        guiding="off",
        spectral="off",
        background="visible",
        clamp_indirect=0.0,
        light_groups="",
        light_paths="off",
        cryptomatte=0,
        deep=0,
        environment=(0.0, 0.0, 0.0),
        environment_strength=1.0,
        environment_rotation=0.0,
    )
