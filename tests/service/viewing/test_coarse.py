"""Tests of the accuracy of tiles that a live view sends with reduced precision to save bandwidth."""

from __future__ import annotations

import numpy as np
import pytest

from protocol.pictures import ViewTile, decode_view, encode_view
from renderer.image import rgbe9995
from renderer.settings import Tile


def decode_tiles(tiles: list[ViewTile]) -> list[np.ndarray]:
    """Returns the radiance (3, h, w) of each tile as decoded by the page."""
    message = encode_view(tiles, (64, 64), (128, 128), 7, 9)
    picture = decode_view(message)
    assert picture.head == (len(tiles), 7, 9, 64, 64, 128, 128)
    for tile, sent in zip(picture.tiles, tiles, strict=True):
        np.testing.assert_array_equal(tile.alpha, sent.alpha)
    told = [(tile.rect, tile.samples, tile.is_exact) for tile in picture.tiles]
    assert told == [(tile.rect, tile.samples, tile.is_exact) for tile in tiles]
    return [tile.mean for tile in picture.tiles]


def shown(mean: np.ndarray, is_exact: bool = False, samples: int = 3) -> ViewTile:
    _, h, w = mean.shape
    return ViewTile(Tile(1, 2, w, h), mean.astype(np.float32), samples, is_exact)


def test_coarse_brightness_and_hue_are_accurate() -> None:
    generator = np.random.default_rng(1)
    four = generator.uniform(0.01, 1, (3, 5, 7)).repeat(2, 1).repeat(2, 2)[:, :9, :13]  # odd sides
    mean = four * 2.0 ** generator.uniform(-18, 12, (9, 13))
    (found,) = decode_tiles([shown(mean)])
    brightness = mean.sum(0)
    np.testing.assert_allclose(found.sum(0), brightness, rtol=1 / 64 + 3 * 2**-9)
    np.testing.assert_allclose(found / brightness, mean / brightness, atol=1 / 64 + 2 / 255 + 2**-9)


def test_black_and_bright_pixels_are_preserved() -> None:
    mean = np.zeros((3, 2, 4))
    mean[:, 0, 0] = 0.8, 0.1, 0.1
    mean[:, 1, 3] = 1e9, -1.0, np.nan
    (found,) = decode_tiles([shown(mean)])
    np.testing.assert_allclose(found[:, 0, 0], mean[:, 0, 0], atol=0.02)
    np.testing.assert_allclose(found[:, 1, 3], (rgbe9995.MAX, 0, 0), rtol=0.02)
    assert np.count_nonzero(found.sum(0)) == 2


def test_complete_tiles_are_exact() -> None:
    generator = np.random.default_rng(2)
    tiles = [shown(generator.uniform(0, 9, (3, h, w)), h % 2 == 0) for h, w in ((8, 8), (3, 5), (4, 9), (7, 2))]
    tiles = [tile._replace(alpha=generator.integers(0, 256, tile.mean.shape[1:], np.uint8)) for tile in tiles]
    for tile, found in zip(tiles, decode_tiles(tiles), strict=True):
        if tile.is_exact:
            np.testing.assert_array_equal(rgbe9995.pack(np.moveaxis(tile.mean, 0, -1)), rgbe9995.pack(np.moveaxis(found, 0, -1)))
        else:
            np.testing.assert_allclose(found.sum(0), tile.mean.sum(0), rtol=1 / 64 + 3 * 2**-9)


@pytest.mark.parametrize(("noise", "bits"), [(0.5, 7.5), (0.05, 5)])
def test_noisy_pixel_takes_few_bits(noise: float, bits: float) -> None:
    generator = np.random.default_rng(3)
    mean = np.array([0.4, 0.3, 0.2])[:, None, None] * generator.lognormal(0, noise, (128, 128))
    assert len(encode_view([shown(mean)], (128, 128), (128, 128), 0, 0)) < bits / 8 * 128 * 128
