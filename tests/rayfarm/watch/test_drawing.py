"""Tests of pictures drawn as half blocks, kitty's graphics and sixels, decoded as by a terminal."""

from __future__ import annotations

import numpy as np
import pytest

from rayfarm.watch.blocks import Blocks, nearest_256
from rayfarm.watch.fit import fitted_picture, fitted_size
from rayfarm.watch.pixels import Kitty, Sixel
from rayfarm.watch.terminal import CELL, parse_answers
from renderer.image import tonemap
from tests.rayfarm.watch.seen import Seen, colour_256

RANDOM = np.random.default_rng(5)


def smooth(width: int, height: int) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return np.stack([255 * x / width, 255 * y / height, 128 + 0 * x], axis=-1).astype(np.uint8)


def test_half_blocks_draw_only_changed_rows() -> None:
    picture = RANDOM.integers(0, 256, (20, 30, 3), np.uint8)
    blocks, screen = Blocks(is_true_colour=True), Seen(40, 12)
    screen.take(blocks.draw(picture, 3, 2))
    np.testing.assert_array_equal(screen.blocks(), picture)
    assert blocks.draw(picture, 3, 2) == b""
    changed = picture.copy()
    changed[7] = 9
    screen.drawn.clear()
    screen.take(blocks.draw(changed, 3, 2))
    np.testing.assert_array_equal(screen.blocks(), changed)
    assert {row for row, _ in screen.drawn} == {1 + 7 // 2}
    blocks.discard_drawn()
    assert len(blocks.draw(changed, 3, 2)) > 1000


def test_nearest_of_256_colours_is_used() -> None:
    colours = np.array([colour_256(number) for number in range(16, 256)])
    asked = RANDOM.integers(0, 256, (500, 3), np.uint8)
    got = colours[nearest_256(asked) - 16]
    best = ((colours[None] - asked[:, None].astype(int)) ** 2).sum(-1).min(1)
    mine = ((got - asked.astype(int)) ** 2).sum(-1)
    assert (mine <= best + 3 * 10**2).all(), "but for a grey beside the nearest"
    screen = Seen(8, 8)
    screen.take(Blocks(is_true_colour=False).draw(np.full((2, 2, 3), 255, np.uint8), 1, 1))
    np.testing.assert_array_equal(screen.blocks(), 255)


def test_kitty_shows_one_exact_picture() -> None:
    kitty, screen = Kitty((10, 20)), Seen(80, 24)
    for seed in range(3):
        picture = np.random.default_rng(seed).integers(0, 256, (50, 70, 3), np.uint8)
        screen.take(kitty.draw(picture, 4, 2))
        (only,) = screen.images.values()
        np.testing.assert_array_equal(only, picture)
    assert kitty.cells((70, 50)) == (7, 3)
    screen.take(kitty.clearing_bytes())
    assert not screen.images


def test_sixels_show_few_colours_exactly() -> None:
    screen = Seen(80, 24)
    flat = np.zeros((13, 17, 3), np.uint8)
    flat[3:9, 5:] = (255, 0, 51)
    screen.take(Sixel((10, 20)).draw(flat, 1, 1))
    np.testing.assert_array_equal(screen.sixel, flat)
    picture = smooth(64, 50)
    screen.take(Sixel((10, 20)).draw(picture, 1, 1))
    assert screen.sixel is not None
    assert np.abs(screen.sixel.astype(int) - picture).mean() < 6, "256 colours"


def test_scaled_picture_fits_and_averages_radiance() -> None:
    assert fitted_size((1920, 1080), (80, 60)) == (80, 45)
    assert fitted_size((64, 48), (200, 100)) == (128, 96)
    assert fitted_size((4000, 10), (80, 60)) == (80, 1)
    film = RANDOM.uniform(0, 2, (40, 60, 3)).astype(np.float32)
    np.testing.assert_array_equal(fitted_picture(film, (60, 40), 0.5, "agx"), tonemap.apply(film, 0.5, "agx"))
    halves = film.reshape(20, 2, 30, 2, 3).mean(axis=(1, 3))
    assert np.abs(fitted_picture(film, (30, 20), 0.0, "neutral").astype(int) - tonemap.apply(halves)).max() <= 1
    np.testing.assert_array_equal(fitted_picture(film, (120, 80), 0.0, "srgb")[::2, 1::2], tonemap.apply(film, 0.0, "srgb"))


@pytest.mark.parametrize(
    ("answers", "kitty", "sixel", "true_colour", "cell"),
    [
        (b"\x1b_Gi=31;OK\x1b\\\x1bP1$r0;48:2::1:2:3m\x1b\\\x1b[6;18;9t\x1b[?62;c", True, False, True, (9, 18)),
        (b"\x1bP1$r0;48;2;1;2;3m\x1b\\\x1b[?62;4;22c", False, True, True, CELL),
        (b"\x1bP1$r0m\x1b\\\x1b[?64;1;2;6;44c", False, False, False, CELL),
        (b"\x1b_Gi=31;ENOTSUPPORTED\x1b\\\x1b[?6c", False, False, False, CELL),
        (b"", False, False, False, CELL),
    ],
)
def test_terminal_answers_are_parsed(answers: bytes, kitty: bool, sixel: bool, true_colour: bool, cell: tuple[int, int]) -> None:
    can = parse_answers(answers)
    assert (can.kitty, can.sixel, can.true_colour, can.cell) == (kitty, sixel, true_colour, cell)
