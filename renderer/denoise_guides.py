"""The albedo behind mirrors and smooth glass, a better guide for denoising than theirs.

A film's albedo is that of the first hit, which says nothing about what a mirror shows. Open Image Denoise advises to follow
reflections and refractions that are perfectly specular to the first surface that is not
(https://www.openimagedenoise.org/documentation.html, "Albedos"). Such an albedo is a picture of its own: that of the scene in
which these surfaces are as they are, and all others show their base colour without any light. It is rendered with a few
samples, and differs from the film's albedo only where such surfaces are. It depends on the scene and the settings alone, and
the frame's own kernel renders it, so workers of the farm make the same one.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.arrays.scene import CompiledScene
from renderer.denoise import denoise
from renderer.film import ALBEDO, COLOR, NORMAL, Sums, mean
from renderer.kernel.accumulate import has_variants
from renderer.kernel.bsdf.rough_glass import SMOOTH_GLASS
from renderer.render import render_batch, variant_for
from renderer.settings import RenderSettings, Tile, tiles_of
from renderer.threads import cores

__all__ = ["denoise_still", "guide_kernel", "guide_scene", "guiding_albedo"]

F32 = npt.NDArray[np.float32]

SAMPLES = 16  # per pixel; 64 reduced the denoised picture's error by 1 to 5 % more
_MOST_SAMPLES = 1 << 25  # of all pixels: larger pictures have fewer each; some 17 s of one core
_LEAST = 2  # samples per pixel
_TILE = 64
_SMOOTH_METAL = 0.15  # greatest roughness of a metal in which objects are recognized
_METAL = 0.9  # least metallic
_UNSEEN_FLAGS = np.int32(rows.HOLDOUT | rows.CATCHES | rows.SCATTERS_WITHIN)


def guiding_albedo(scene: CompiledScene, settings: RenderSettings, albedo: F32, threads: int | None = None) -> F32:
    """Returns the albedo with which to guide the denoising of a whole frame, (h, w, 3) float32.

    albedo: that of the frame's film; it is returned itself if no surface is a mirror or smooth glass, if media scatter, or if the
    settings need a path tracer other than that of pictures. settings: of the frame. threads: None for all cores. The result
    depends on nothing else, and equals `albedo` in pixels in which no sample meets such a surface.
    """
    kernel = guide_kernel(scene, settings)
    if kernel is None or albedo.shape[:2] != (settings.height, settings.width):
        return albedo
    (drawn, variant), shown, exponent = kernel, guide_scene(scene), settings.film_exponent
    assert shown is not None
    count = max(_LEAST, min(SAMPLES, _MOST_SAMPLES // (settings.width * settings.height)))
    guide = np.empty(albedo.shape, np.float32)

    def render(tile: Tile) -> None:
        sums = render_batch(shown, drawn, tile, 0, count, variant=variant).sums
        place = np.s_[tile.y : tile.y + tile.h, tile.x : tile.x + tile.w]
        guide[place] = np.clip(albedo[place] + (mean(sums, exponent) - mean(sums, exponent, ALBEDO)), 0, 1)

    with ThreadPoolExecutor(threads or cores(), thread_name_prefix="guide") as pool:
        list(pool.map(render, tiles_of(settings.width, settings.height, _TILE)))
    return guide


def guide_kernel(scene: CompiledScene, settings: RenderSettings) -> tuple[RenderSettings, str] | None:
    """Returns the settings and the variant of the kernel that renders the guide; None if the film's albedo is the guide.

    It is the frame's own kernel, unless the settings ask for `guiding`, `spectral` or `caustics`. scene, settings: of the frame.
    """
    if not has_variants(settings) or guide_scene(scene) is None:
        return None
    drawn = _guide_settings(settings)
    return drawn, variant_for(drawn, scene)


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
    """Returns the settings of the guide's picture: the view, sample numbers and kernel of the frame, without its light."""
    return replace(
        settings,
        splitting=1,
        caustics="off",
        guiding="off",
        spectral="off",
        background="visible",
        clamp_indirect=0.0,
        cryptomatte=0,
        deep=0,
        environment=(0.0, 0.0, 0.0),
        environment_strength=1.0,
        environment_rotation=0.0,
    )
