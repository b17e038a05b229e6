"""Tests of how the page finds black pictures, and of the points that it picks to find surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.image import rgbe9995
from tests.page.node import Node


@pytest.mark.parametrize(
    ("faint", "value", "is_black"),
    [(0, 0.0, True), (20, 2e-5, True), (20, 1e-3, False), (300, 2e-5, False)],
    ids=["zero", "left by a denoiser", "a lamp is seen", "dark all over"],
)
def test_film_is_black_although_a_denoiser_leaves_faint_pixels(node: Node, faint: int, value: float, is_black: bool) -> None:
    values = np.zeros((1, 10_000, 3), np.float32)
    values[:, :faint] = value
    body = """
        const film = new m.Film(10000, 1, new Uint32Array(a));
        const before = film.isBlack();
        film.samples.fill(1);
        return [before, film.isBlack()];"""
    words = rgbe9995.pack(values).ravel().tolist()
    assert node.call("film/film", body, words) == [False, is_black], "not before all pixels have samples"


def test_probe_asks_from_the_middle_and_ends_at_the_first_surface(node: Node) -> None:
    body = """
        const asked = [];
        const probing = m.probe((at) => asked.push(at));
        const answers = [];
        probing.begin({ width: 70, height: 50 }, (sees) => answers.push(sees));
        probing.take({ x: 0, y: 0, depth: 3 }); // picked by the user
        probing.take({ x: asked[0][0], y: asked[0][1], depth: null });
        probing.take({ x: asked[1][0], y: asked[1][1], depth: 2 });
        const seen = asked.length;
        probing.begin({ width: 70, height: 50 }, (sees) => answers.push(sees));
        while (answers.length < 2) { const [x, y] = asked.at(-1); probing.take({ x, y, depth: null }); }
        return { first: asked[0], seen, all: new Set(asked.map(String)).size, answers };"""
    found = node.call("scene/probe", body)
    assert found == {"first": [35, 25], "seen": 2, "all": 35, "answers": [True, False]}
