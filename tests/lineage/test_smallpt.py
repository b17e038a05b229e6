"""Tests of scenes/smallpt.yaml against a plain NumPy evaluation of the same scene, pixel by pixel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, View
from tests.lineage import smallpt_reference
from tests.renderer.judge import ALPHA, sidak

SCENES = Path(__file__).parents[2] / "scenes"
WIDTH, HEIGHT = 32, 24
OUR_SPP, SEEDS = 48, 12


def ours() -> tuple[np.ndarray, np.ndarray]:
    """Renders the scene several times with different seeds; returns (mean, variance of the mean), each (h, w, 3)."""
    description = read(SCENES, "smallpt.yaml")
    scene = compile_scene(description)
    plain = RenderSettings(WIDTH, HEIGHT, description.cameras[0].view, max_depth=200, filter="box", sampler="independent")
    pictures = np.array(
        [mean(render_frame(scene, replace(plain, seed=seed), OUR_SPP), plain.film_exponent) for seed in range(SEEDS)], np.float64
    )
    return pictures.mean(0), pictures.var(0, ddof=1) / SEEDS


@pytest.mark.long
@pytest.mark.parametrize("reference_spp", [400, pytest.param(1500, marks=pytest.mark.long)])
def test_every_pixel_agrees_with_the_plain_evaluation(reference_spp):
    """Our picture of smallpt's scene agrees with the plain NumPy picture.

    The means of the pictures agree, and 99.75 % of all pixels pass a Z-test at alpha 0.01 with Sidak's correction, as in
    Mitsuba's tests.
    """
    expected, their_variance = smallpt_reference.render(WIDTH, HEIGHT, reference_spp)
    actual, our_variance = ours()
    error = np.sqrt(their_variance + our_variance).mean(-1) + 1e-9
    z = np.abs(actual.mean(-1) - expected.mean(-1)) / error
    far = scipy.stats.norm.isf(sidak(ALPHA, z.size) / 2)
    assert (z < far).mean() >= 0.9975
    total = np.sqrt((their_variance + our_variance).mean(-1).sum()) / z.size
    assert abs(actual.mean() - expected.mean()) < 3 * total


@pytest.mark.long
@pytest.mark.parametrize("target", [(1, 40, 110), (99, 45, 120), (50, 0, 130), (50, 45, 0)])
def test_huge_walls_do_not_shadow_themselves(target):
    """Rays that start on a wall hit nothing within 15 units.

    smallpt's walls are huge spheres; if they intersected themselves, rings of shadow would be visible.
    """
    description = read(SCENES, "smallpt.yaml")
    view = View((50.0, 40.0, 100.0), target, fov=8.0, up=(0.0, 0.3, 1.0))
    settings = RenderSettings(32, 32, view, integrator="ao", ao_distance=15.0)
    picture = mean(render_frame(compile_scene(description), settings, 64), settings.film_exponent)
    assert (picture == 1.0).all()
