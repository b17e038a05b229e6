"""Tests of USD: subsurface and transmission of MaterialX surfaces, by the formulas of their specifications."""

import numpy as np
import pytest

from tests.renderer.scene.test_usd_materials import shaded  # noqa: F401
from tests.renderer.scene.test_usd_materialx import OPEN_PBR, STANDARD, C, F, looks  # noqa: F401
from tests.renderer.scene.usd_files import TYPES


def test_subsurface_radius(looks):  # noqa: F811
    found, look = looks(
        base_color=(C, (0.2, 0.4, 0.6)),
        base=(F, 0.5),
        subsurface=(F, 0.25),
        subsurface_color=(C, (0.5, 0.5, 1.0)),
        subsurface_radius=(C, (3, 2, 1)),
        subsurface_scale=(F, 0.5),
        subsurface_anisotropy=(F, 0.3),
    )
    np.testing.assert_allclose(look.base_color, (0.2, 0.275, 0.475), atol=1e-6)
    np.testing.assert_allclose(look.subsurface_radius, (1.5, 1, 0.5))
    assert (look.subsurface, look.subsurface_anisotropy) == (0.25, pytest.approx(0.3))
    assert not any("MaterialX" in w for w in found.warnings)
    _, look = looks(OPEN_PBR, subsurface_weight=(F, 1.0), subsurface_radius=(F, 2.0))
    np.testing.assert_allclose(look.subsurface_radius, (2, 1, 0.5))


def test_thin_sheet_transmits_scattered_light(looks):  # noqa: F811
    """A thin sheet scatters to its other side: all scattered light in Standard Surface, (1 + g) / 2 of it in OpenPBR."""
    color = (C, (0.5, 0.25, 1.0))
    _, look = looks(thin_walled=(TYPES.Bool, True), subsurface=(F, 0.5), subsurface_color=color, base_color=(C, (0.1,) * 3))
    assert (look.diffuse_transmission, look.diffuse_transmission_color, look.subsurface) == (0.5, (0.5, 0.25, 1), 0)
    np.testing.assert_allclose(look.base_color, (0.1,) * 3, atol=1e-6)
    _, look = looks(
        OPEN_PBR,
        geometry_thin_walled=(TYPES.Bool, True),
        subsurface_weight=(F, 1.0),
        subsurface_color=color,
        subsurface_scatter_anisotropy=(F, 0.5),
    )
    assert look.diffuse_transmission == pytest.approx(0.75)
    np.testing.assert_allclose(look.base_color, (0.5, 0.25, 1.0), atol=1e-6)


@pytest.mark.parametrize(("kind", "weight"), [(STANDARD, "transmission"), (OPEN_PBR, "transmission_weight")])
def test_glass_with_scattering_interior(looks, kind, weight):  # noqa: F811
    """The attenuation of light in glass, given by a colour at a depth, is divided into scattering and absorption.

    If scattering exceeds attenuation in a channel, absorption is raised equally in all channels.
    """
    inputs = {weight: (F, 1.0), "transmission_color": (C, (0.5, 0.25, 0.8)), "transmission_depth": (F, 2.0)}
    found, look = looks(kind, **inputs, transmission_scatter=(C, (0.2, 0.4, 0.6)), transmission_scatter_anisotropy=(F, 0.25))
    np.testing.assert_allclose(look.sigma_s, (0.1, 0.2, 0.3), atol=1e-6)
    lacking = 0.3 + np.log(0.8) / 2
    np.testing.assert_allclose(look.sigma_a, -np.log((0.5, 0.25, 0.8)) / 2 - (0.1, 0.2, 0.3) + lacking, atol=1e-6)
    assert (look.g, look.attenuation_distance, look.base_color) == (0.25, np.inf, (1, 1, 1))
    assert not any("MaterialX" in w for w in found.warnings)
