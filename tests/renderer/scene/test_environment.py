"""Tests of leaving the constant part of an environment to BSDF sampling, so that light sampling covers only the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import RenderStats, render_frame
from renderer.scene.description import Environment, Material, Sphere
from renderer.scene.environment import without_environment_sampling
from renderer.scene.sky import Sky
from renderer.settings import RenderSettings, View
from tests.renderer.builders import emitter, gray, scene, square

GRAY, LAMP = Material(base_color=gray(0.5)), emitter(4.0)
FLOOR = square((0, 0, 0), (20, 0, 0), (0, 0, -20), 0)
ABOVE = square((0, 3.0, 0), (1, 0, 0), (0, 0, 1), 1)
TWO = np.array([[[1, 1, 1], [3, 3, 3]]], np.float32)


@pytest.mark.parametrize(("environment", "left"), [(0.5, True), (TWO, False), (Environment(sky=Sky(35)), False)])
def test_only_constant_environments_skip_light_sampling(environment, left):
    made = scene([GRAY, LAMP], (FLOOR, ABOVE), environment=environment)
    assert made.environment_frame[3] > 0
    found = without_environment_sampling(made)
    assert (found.environment_frame[3] == 0) == left
    np.testing.assert_array_equal(np.delete(found.environment_frame, 3), np.delete(made.environment_frame, 3))


def test_light_sampling_is_kept_with_shadeless_objects():
    made = scene([GRAY, replace(LAMP, lamp=True)], (FLOOR, ABOVE), environment=0.5)
    assert without_environment_sampling(made).environment_frame[3] == made.environment_frame[3] > 0


def test_unoccluded_constant_sky_has_no_noise():
    """A picture of a ball in a constant sky has no noise: all samples are equal.

    Each sample traces three rays, two of them to the sky.
    """
    made = scene([GRAY], spheres=(Sphere((0, 0, 0), 1.0, 0),), environment=0.5)
    stats = RenderStats()
    picture = mean(render_frame(made, RenderSettings(8, 8, View((0, 0, 4), (0, 0, 0), fov=10.0)), 16, stats=stats), 24)
    np.testing.assert_allclose(picture, 0.25, rtol=1e-5)
    assert stats.rays == 3 * stats.samples
