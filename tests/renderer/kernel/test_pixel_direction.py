"""Tests that the service computes the same direction for a pixel as the kernel's camera."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.settings import View
from service.viewing.pixel_direction import pixel_direction
from tests.renderer.kernel.test_camera import LEVEL, TILTED, rays


@pytest.mark.parametrize("projection", ["perspective", "orthographic", "panorama"])
@pytest.mark.parametrize("place", [LEVEL, TILTED])
def test_pixel_direction_matches_the_kernel_ray(projection: str, place: dict[str, tuple[float, float, float]]) -> None:
    view = View(**place, projection=projection, fov=50, shift_x=0.3, shift_y=-0.7)
    points = [(0.5, 0.5), (32.0, 24.0), (63.5, 10.5), (20.25, 47.5)]
    _, directions = rays(view, *zip(*points, strict=True))
    np.testing.assert_allclose([pixel_direction(view, 64, 48, x, y) for x, y in points], directions, atol=1e-6)
