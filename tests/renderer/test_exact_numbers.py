"""Tests that values computed by workers from settings, and tables in kernels, have the same bits on every host.

The last bits of NumPy's functions, BLAS and the C library depend on the processor and the release.
"""

from __future__ import annotations

import math
from decimal import Decimal, getcontext
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from renderer.kernel.camera import axes_of, camera_frame
from renderer.kernel.material.texture import DECODED
from renderer.luminance import REC_709, luminance
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Image, Material, SceneDescription, Sphere
from renderer.scene.environment import environment_sampled_fully, with_environment_changed
from renderer.settings import RenderSettings, View

VIEW = View((0.1, 1.7, 5.3), (-0.3, 0.7, 0.2), up=(0.1, 1.0, 0.3), fov=41.3)


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes the functions whose last bits depend on the host, such as np.sin, raise an AssertionError."""

    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("the result depends on the host")

    for module in (math, np):
        for name in ("sin", "cos", "tan", "exp", "log", "arctan2", "atan2", "power", "dot", "matmul", "einsum"):
            monkeypatch.setattr(module, name, refuse, raising=False)


def test_luminance_has_reproducible_bits() -> None:
    colors = np.random.default_rng(0).random((500, 3)) ** 5
    r, g, b = REC_709.tolist()
    assert luminance(colors).tolist() == [(x * r + y * g) + z * b for x, y, z in colors.tolist()]


@pytest.mark.usefixtures("bare")
def test_camera_has_reproducible_bits() -> None:
    frame = camera_frame(RenderSettings(640, 360, VIEW))
    (ex, ey, ez), (tx, ty, tz) = VIEW.eye, VIEW.target
    x, y, z = tx - ex, ty - ey, tz - ez
    length = math.sqrt((x * x + y * y) + z * z)
    assert (-axes_of(VIEW)[2]).tolist() == [x / length, y / length, z / length]
    assert frame.forward == tuple(np.float32(v / length) for v in (x, y, z))


def test_rotated_environment_has_reproducible_bits(request: pytest.FixtureRequest) -> None:
    pixels = np.random.default_rng(1).random((6, 12, 3)).astype(np.float32)
    scene = compile_scene(
        SceneDescription(
            spheres=[Sphere((0.0, 0.0, 0.0), 1.0, 0)],
            materials=[Material()],
            environment=Environment(image=0),
            images=[Image("sky", pixels, srgb=False)],
        )
    )
    request.getfixturevalue("bare")
    turned = environment_sampled_fully(with_environment_changed(scene, None, 1.5, 30.0))
    assert turned.environment_frame[0] == pytest.approx(math.sqrt(0.75), abs=1e-7)
    assert turned.environment_frame[1] == pytest.approx(0.5, abs=1e-7)


def test_decoded_srgb_is_far_from_rounding_boundaries() -> None:
    """No sRGB code decodes to a value near a float32 rounding boundary, so a pow with a relative error of 1e-12 suffices."""
    getcontext().prec = 40
    for code in range(1, 256):
        value = Decimal(code) / 255
        linear = value / Decimal("12.92") if code <= 10 else ((value + Decimal("0.055")) / Decimal("1.055")) ** Decimal("2.4")
        found = DECODED[256 + code]
        near = [Fraction(float(each)) for each in (np.nextafter(found, np.float32(0)), found, np.nextafter(found, np.float32(2)))]
        exact, margin = Fraction(linear), Fraction(linear) / 10**12
        assert (near[0] + near[1]) / 2 + margin < exact < (near[1] + near[2]) / 2 - margin, code
