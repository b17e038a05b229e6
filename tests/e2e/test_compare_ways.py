"""Tests of error metrics of two pictures, and of their display on the page."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from renderer.image import rgbe9995, tonemap
from tests.e2e.conftest import Watched
from tests.e2e.flip_judge import flip
from tests.e2e.screen import read_exr, render_job
from tests.e2e.site import call
from tests.helpers import Farm

NVIDIAS = 0.155813  # computed by flip-evaluator 1.7 for the two pictures below


def two_pictures() -> tuple[np.ndarray, np.ndarray]:
    """Returns two pictures for comparison, (48, 64, 3) uint8: one of soft colours, and the same one with noise and a red bar."""
    y, x = np.mgrid[0:48, 0:64]
    a = np.stack([np.sin(x / 5) * 0.5 + 0.5, np.cos(y / 7) * 0.5 + 0.5, (x + y) / 110], -1)
    b = np.clip(a + np.random.default_rng(5).normal(0, 0.06, a.shape), 0, 1)
    b[20:30, 30:33] = [0.9, 0.1, 0.2]
    return (a * 255 + 0.5).astype(np.uint8), (b * 255 + 0.5).astype(np.uint8)


def rgba(picture: np.ndarray) -> list[int]:
    return np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)]).ravel().tolist()


@pytest.mark.long
def test_flip_equals_reference_implementation(page: Page) -> None:
    a, b = two_pictures()
    body = "const r = m.flip(new Uint8Array(a[0]), new Uint8Array(a[1]), 64, 48); return [r.mean, [...r.map]];"
    mean, found = call(page, "compare/flip", body, [rgba(a), rgba(b)])
    wanted = flip(a / 255, b / 255)
    np.testing.assert_allclose(np.array(found).reshape(48, 64), wanted, atol=1e-4)
    assert mean == pytest.approx(NVIDIAS, abs=2e-5) and wanted.mean() == pytest.approx(NVIDIAS, abs=2e-5)
    assert call(page, "compare/flip", body, [rgba(a), rgba(a)])[0] == 0


@pytest.mark.long
def test_differences_are_measured_and_shown(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    size = {"width": 96, "height": 64}
    jobs = [render_job(farm, scene, **size, spp=4, max_depth=depth) for depth in (2, 9)]
    exact = [read_exr(f"{farm.url}/api/jobs/{job}/frames/0/image.exr", tmp_path) for job in jobs]
    films = [rgbe9995.unpack(rgbe9995.pack(film)).astype(float) for film in exact]
    shown = [tonemap.apply(film.astype(np.float32), -1.0, "hue") / 255 for film in films]
    square = (films[0] - films[1]) ** 2
    wanted = [square.mean(), (square / (films[0] ** 2 + 0.01)).mean(), flip(*shown).mean()]

    page = watched.page
    page.goto(f"{farm.url}/#/compare/{jobs[0]}/{jobs[1]}?ev=-1&tone=hue&way=flip")
    ways = page.get_by_label("Ways to compare")
    expect(ways).to_contain_text("A is the reference")
    figures = [float(text) for text in ways.locator("dd").all_inner_texts()]
    np.testing.assert_allclose(figures, wanted, rtol=2e-3)
    expect(page.get_by_role("heading", level=1)).to_have_text(re.compile("Comparison of "))
    ways.get_by_text("Difference", exact=True).click()
    bar = ways.get_by_role("img", name="Root of the mean squared difference")
    expect(bar).to_be_visible()
    high = float((bar.get_attribute("aria-label") or "").split("; ")[-1])
    errors = np.sort(np.sqrt(square.mean(axis=2)).ravel())
    assert high == pytest.approx(errors[int((errors.size - 1) * 0.99)], rel=2e-3)
    expect(page).to_have_url(re.compile("way=difference"))

    # Side by side, the same pixel is read on both sides.
    ways.get_by_text("Side", exact=True).click()
    stage = page.locator(".stage")
    places = []
    for at in (0.25, 0.25, 0.75, 0.75):  # twice, since the first values reduce the stage's size
        box = stage.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + at * box["width"], box["y"] + box["height"] / 2)
        expect(page.locator(".values.exact").first).to_be_visible()
        places.append(page.get_by_label("Pixel under the cursor").first.locator(".place").inner_text())
    assert places[1] == places[3] and re.match(r"4[78], 3[12]", places[1])

    # While the key is held, B shows the other picture.
    ways.get_by_text("Wipe", exact=True).click()
    page.keyboard.down("b")
    expect(page.locator(".turn-tag")).to_have_text("B")
    page.keyboard.up("b")
    expect(page.get_by_role("slider", name="Wipe")).to_be_visible()
    ways.get_by_text("Flicker", exact=True).click()
    tag = page.locator(".turn-tag")
    expect(tag).to_have_text("A")
    expect(tag).to_have_text("B")
    assert watched.errors == []
