"""Tests of instance transforms against NumPy's LAPACK routines."""

import numpy as np

from renderer.bvh.transforms import invert_transforms, scale_range
from tests.renderer.bvh.test_instances import transforms


def test_inverses_and_scales_match_lapack():
    rng = np.random.default_rng(1)
    places = transforms(rng, 500) * np.exp(rng.uniform(-20, 20, 500))[:, None, None]
    found = invert_transforms(places)
    whole = np.concatenate([places, np.tile([[[0, 0, 0, 1.0]]], (500, 1, 1))], axis=1)
    np.testing.assert_allclose(found, np.linalg.inv(whole)[:, :3], rtol=1e-9, atol=1e-12 * np.abs(found).max())
    expected = np.linalg.svd(places[:, :, :3], compute_uv=False)[:, ::2]
    np.testing.assert_allclose(scale_range(places), expected, rtol=1e-13)


def test_scales_of_singular_and_invalid_transforms():
    flat = np.eye(4)[None, :3] * np.array([1.0, 3.0, 0.0])[:, None]
    turned = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    sheared = np.zeros((1, 3, 4))
    sheared[0, :, :3] = turned @ np.diag([1e-7, 1.0, 2.0])
    for place in (flat, np.zeros((1, 3, 4)), sheared):
        expected = np.linalg.svd(place[:, :, :3], compute_uv=False)[:, ::2]
        np.testing.assert_allclose(scale_range(place), expected, rtol=1e-8, atol=1e-15)
    for bad in (np.nan, np.inf):
        assert np.isnan(scale_range(np.full((1, 3, 4), bad))).all()
