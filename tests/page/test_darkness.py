"""Tests that the page detects dark pictures as renderer/image/darkness.py does, and of its automatic exposure."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.image import rgbe9995
from renderer.image.darkness import darkness
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


@pytest.mark.parametrize(
    ("white", "mean", "stops"),
    [
        (2.0, 0.3, 0),  # a lamp is seen, and the rest is well exposed
        (1.0, 0.01, 1.5),  # a lamp in a dark room: brighter, but not without limit
        (0.5, 0.02, 2.5),  # a low sun
        (0.65, 0.35, 0.5),  # nothing is white
        (0.0, 0.0, 0),  # black: no exposure helps
        (2**-10, 2**-11, 10),
    ],
)
def test_automatic_exposure_brightens_dark_and_dull_pictures(node: Node, white: float, mean: float, stops: float) -> None:
    assert node.call("film/darkness", "return m.autoExposure(a);", {"white": white, "mean": mean}) == stops


def test_transparent_background_does_not_darken_a_picture(node: Node) -> None:
    """Half of the pixels are covered and evenly lit: their brightness alone is the picture's."""
    words = rgbe9995.pack(np.repeat(np.float32([0.0, 0.5]), 2000)[:, None].repeat(3, axis=1)[None])
    body = """
        const film = new m.Film(4000, 1, new Uint32Array(a));
        film.samples.fill(1);
        film.coverage = new Uint8Array(4000).fill(255, 2000);
        return film.brightness();"""
    assert node.call("film/film", body, words.ravel().tolist()) == pytest.approx({"white": 0.5, "mean": 0.5}, rel=1e-3)
