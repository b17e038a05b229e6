"""Tests that segments of round curves scatter sunlight as finely divided tubes of triangles do."""

import numpy as np
import pytest

from renderer.arrays.kernel_variant import variant_of
from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.curve_meshes import has_curves, round_tubes
from renderer.scene.description import Light, Material
from renderer.scene.readers.strands import Strand, strands_mesh
from tests.renderer.builders import gray, scene, settings

pytestmark = pytest.mark.long

HAIR = Material(kind="hair", base_color=gray(0.6))
SUN = Light("directional", intensity=(1.0, 1.0, 1.0), direction=(-0.5, -0.75, -0.55))


@pytest.mark.parametrize("scale", [0.05, 1.0])
def test_sunlit_segments_are_as_bright_as_tubes(scale: float) -> None:
    """The scales of the fibre are tilted towards its root, so a mirrored frame would change its brightness by a third."""
    height = np.linspace(-3, 3, 9)
    points = np.column_stack([0.05 * height + 0.3, height, np.full(9, 0.2)]) * scale
    curve = strands_mesh([Strand(points, np.full(9, 0.03 * scale))], fibres=True)
    assert has_curves(curve)
    found = []
    for mesh in (curve, round_tubes(curve, sides=48)):
        lit = scene([HAIR], (mesh,), lights=(SUN,))
        assert variant_of(lit) == "hair"
        view = settings((0, 0, 6 * scale), (0, 0, 0), fov=8, size=32, max_depth=2)
        found.append(mean(render_frame(lit, view, 256), view.film_exponent).mean())
    assert found[0] > 1e-4
    assert found[0] == pytest.approx(found[1], rel=0.05)
