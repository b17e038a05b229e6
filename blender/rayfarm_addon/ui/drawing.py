"""Draws an image from the farm in a region of Blender's window with the gpu module, using the scene's colour management."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..farm.packets import rgba
from ..farm.watching import ViewPicture

__all__ = ["Canvas"]

Corners = tuple[float, float, float, float]


class Canvas:
    """Draws the last image that was set, and caches its texture. Used in the main thread, while Blender draws."""

    def __init__(self) -> None:
        self._shown: ViewPicture | None = None
        self._cut: Corners = (0.0, 0.0, 1.0, 1.0)
        self._texture: Any = None

    def set_picture(self, picture: ViewPicture, cut: Corners) -> None:
        """Sets the image to draw.

        cut: the part of the image that fills the region: left, low, right, high as fractions from the lower left corner.
        """
        if picture is not self._shown:
            self._shown, self._texture = picture, None
        self._cut = cut

    def draw(self, engine: Any, scene: Any, region: Any) -> None:
        """Draws the image over the whole region."""
        if self._shown is None:
            return
        # Not imported at the top: without a window, Blender has no working gpu module.
        import gpu
        from gpu_extras.batch import batch_for_shader

        if self._texture is None:
            pixels = rgba(self._shown.rgb)
            height, width = pixels.shape[:2]
            flat = np.ascontiguousarray(pixels.ravel())
            buffer = gpu.types.Buffer("FLOAT", len(flat), flat)
            self._texture = gpu.types.GPUTexture((width, height), format="RGBA16F", data=buffer)
        left, low, right, high = self._cut
        corners = {
            "pos": ((0, 0), (region.width, 0), (region.width, region.height), (0, region.height)),
            "texCoord": ((left, low), (right, low), (right, high), (left, high)),
        }
        gpu.state.blend_set("ALPHA_PREMULT")
        engine.bind_display_space_shader(scene)
        shader = gpu.shader.from_builtin("IMAGE")
        batch = batch_for_shader(shader, "TRI_FAN", corners)
        shader.bind()
        shader.uniform_sampler("image", self._texture)
        batch.draw(shader)
        engine.unbind_display_space_shader()
        gpu.state.blend_set("NONE")
