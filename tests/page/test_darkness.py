"""Tests that the page detects dark pictures as renderer/image/darkness.py does, and of its automatic exposure."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.image import rgbe9995
from renderer.image.darkness import darkness
from renderer.image.tonemap import apply
from tests.page.node import Node


@pytest.mark.parametrize("scale", [1.0, 0.011, 0.009, 3e-4, 1e-5])
def test_dark_film_is_detected_as_in_python(node: Node, scale: float) -> None:
    picture = (scale * np.random.default_rng(5).uniform(0.5, 1, (40, 50, 3))).astype(np.float32)
    words = rgbe9995.pack(picture)
    body = """
        const { Film } = await read("/js/film/film.js");
        const film = new Film(50, 40, new Uint32Array(a));
        film.samples.fill(1);
        return m.darkness(film.brightness());"""
    found, wanted = node.call("film/darkness", body, words.ravel().tolist()), darkness(rgbe9995.unpack(words))
    assert (found is None) == (wanted is None)
    if wanted is not None:
        assert found == {"brightest": pytest.approx(wanted.brightest, rel=1e-3), "exposure": wanted.exposure}


def test_radiance_of_displayed_pixels_is_that_of_the_default_curve(node: Node) -> None:
    """Eight bits state it to 3 %, except near white and black."""
    colors = np.random.default_rng(7).uniform(0.05, 1.2, (200, 3)).astype(np.float32)
    found = node.call("film/tonemap", "return a.map(m.undisplayed);", apply(colors).tolist())
    np.testing.assert_allclose(found, colors, rtol=0.03, atol=0.01)


def lit(parts: dict[float, float]) -> list[int]:
    """Returns the words of a grey picture of 10,000 pixels, of which each luminance fills a share."""
    values = np.concatenate([np.full(round(10_000 * share), value) for value, share in parts.items()])
    return [int(word) for word in rgbe9995.pack(np.repeat(values[:, None], 3, axis=1).astype(np.float32)[None]).ravel()]


@pytest.mark.parametrize(
    ("parts", "stops"),
    [
        ({2.0: 0.02, 0.7: 0.05, 0.2: 0.93}, 0.5),  # a lamp is seen, and the rest is nearly well exposed
        ({50.0: 0.02, 0.5: 0.05, 0.055: 0.93}, 2),  # a lamp in a dim room clips, whatever its size
        ({50.0: 0.08, 0.055: 0.92}, 2),
        ({0.4: 0.3, 0.02: 0.7}, 1.25),  # a bright third stays below white
        ({0.0: 0.6, 0.055: 0.4}, 2.5),  # what is black does not count
        ({0.9: 0.2, 0.5: 0.8}, 0),  # a white product is not made grey
        ({6.4: 0.2, 0.5: 0.8}, -3),
        ({0.0: 1.0}, 0),  # black: no exposure helps
        ({2**-10: 1.0}, 8.25),
    ],
)
def test_automatic_exposure_follows_what_is_lit(node: Node, parts: dict[float, float], stops: float) -> None:
    body = """
        const { Film } = await read("/js/film/film.js");
        const film = new Film(10000, 1, new Uint32Array(a));
        film.samples.fill(1);
        return m.autoExposure(film.brightness());"""
    assert node.call("film/darkness", body, lit(parts)) == pytest.approx(stops)


def test_transparent_background_does_not_darken_a_picture(node: Node) -> None:
    """Half of the pixels are covered and evenly lit: their brightness alone is the picture's."""
    words = rgbe9995.pack(np.repeat(np.float32([0.0, 0.5]), 2000)[:, None].repeat(3, axis=1)[None])
    body = """
        const film = new m.Film(4000, 1, new Uint32Array(a));
        film.samples.fill(1);
        film.coverage = new Uint8Array(4000).fill(255, 2000);
        return film.brightness();"""
    assert node.call("film/film", body, words.ravel().tolist()) == pytest.approx(
        {"white": 0.5, "bright": 0.5, "high": 0.5, "key": 0.5}, rel=1e-3
    )
