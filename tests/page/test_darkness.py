"""Tests that the page detects dark pictures as renderer/image/darkness.py does."""

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
        return m.darkness(film);"""
    found, wanted = node.call("film/darkness", body, words.ravel().tolist()), darkness(rgbe9995.unpack(words))
    assert (found is None) == (wanted is None)
    if wanted is not None:
        assert found == {"brightest": pytest.approx(wanted.brightest, rel=1e-3), "exposure": wanted.exposure}


@pytest.mark.parametrize(("brightest", "exposure", "offered"), [(0.2, 0, 2.0), (0.2, 1.5, None), (0.6, 0, None), (0.001, 2, 9.5)])
def test_dim_film_is_offered_the_stops_that_normalise_it(node: Node, brightest: float, exposure: float, offered: float) -> None:
    body = "return m.dimness({ normalisingExposure: () => -Math.log2(a.brightest) }, a.exposure);"
    assert node.call("film/darkness", body, {"brightest": brightest, "exposure": exposure}) == offered
