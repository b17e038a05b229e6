"""Tests of temporal filtering of denoised shots, on synthetic frames with known motion."""

from __future__ import annotations

import numpy as np

from renderer.denoise import DenoisedPicture
from renderer.temporal_denoise import DenoisedFrame, stabilised_frame

SHAPE = (24, 32)
RANDOM = np.random.default_rng(7)
TRUTH = 0.4
NOISE = 0.02


def frame(
    shift: float = 0.0, color: np.ndarray | None = None, albedo: np.ndarray | None = None, object: float = 1.0
) -> DenoisedFrame:
    """Returns a frame of a uniformly lit, noisy wall that moves `shift` pixels to the right per frame."""
    up = np.zeros((*SHAPE, 3), np.float32)
    up[..., 1] = 1.0
    surface = np.full((*SHAPE, 3), 0.5, np.float32) if albedo is None else albedo
    light = TRUTH * (1 + NOISE * RANDOM.standard_normal((*SHAPE, 1))) if color is None else color
    vectors = np.zeros((*SHAPE, 4), np.float32)
    vectors[..., [0, 2]] = -shift
    return DenoisedFrame(
        DenoisedPicture((light * surface).astype(np.float32), surface, up), np.full(SHAPE, object), np.ones(SHAPE), vectors
    )


def off(picture: np.ndarray) -> float:
    inside = picture[:, 6:-6]
    return float(np.sqrt(((inside / 0.5 - TRUTH) ** 2).mean()) / TRUTH)


def test_averaging_five_frames_reduces_the_error() -> None:
    frames = {n: frame() for n in range(5)}
    expected = NOISE / np.sqrt(5)
    assert abs(off(stabilised_frame(frames, 2)) / expected - 1) < 0.1
    moving = {n: frame(shift=1.5) for n in range(5)}
    assert off(stabilised_frame(moving, 2)) < NOISE / 2
    apart = np.abs(stabilised_frame(frames, 2) - stabilised_frame({n: frames[n] for n in (1, 2, 3)}, 2)).mean()
    assert apart > 0
    np.testing.assert_array_equal(stabilised_frame({n: frames[n] for n in (0, 2, 4)}, 2), frames[2].clean.color)


def test_moving_texture_stays_sharp() -> None:
    columns = np.arange(SHAPE[1])
    for shift in (1.0, 0.5):  # a point between two pixels is the mean of both
        frames = {}
        for n in range(5):
            sides = (np.where((columns - way(shift * n)) % 4 < 2, 0.8, 0.2) for way in (np.floor, np.ceil))
            stripes = np.broadcast_to(sum(sides)[None, :, None] / 2, (*SHAPE, 3))
            frames[n] = frame(shift, albedo=stripes.astype(np.float32))
        made = stabilised_frame(frames, 2)
        assert (np.abs(made / frames[2].clean.albedo / TRUTH - 1)[:, 4:-4] < 4 * NOISE).all()


def test_other_objects_and_light_are_not_averaged() -> None:
    here = frame()
    for other in (
        frame(object=2.0),
        frame(color=np.full((*SHAPE, 1), 2 * TRUTH)),
        here._replace(clean=here.clean._replace(color=3 * here.clean.color, normal=-here.clean.normal)),
        here._replace(motion=here.motion + 1, clean=here.clean._replace(color=1.05 * here.clean.color)),
    ):
        np.testing.assert_allclose(stabilised_frame({0: other, 1: here, 2: other}, 1), here.clean.color, rtol=1e-6)


def test_moving_shadow_edge_is_preserved() -> None:
    columns = np.arange(SHAPE[1])
    shadows = {n: np.where(columns < 10 + 2 * n, 0.2, 1.0)[None, :, None] * TRUTH for n in range(5)}
    frames = {n: frame(color=np.broadcast_to(shadow, (*SHAPE, 1))) for n, shadow in shadows.items()}
    np.testing.assert_allclose(stabilised_frame(frames, 2), frames[2].clean.color, rtol=1e-4)
