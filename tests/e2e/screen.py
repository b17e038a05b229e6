"""Reads from a screenshot how the page displays a film, and computes how it should be displayed."""

from __future__ import annotations

import io
import re
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import OpenImageIO
from PIL import Image
from playwright.sync_api import Page, expect

from renderer.image import rgbe9995, tonemap
from tests.helpers import Farm, wait_until

__all__ = ["assert_screen", "assert_shows", "expected_pixels", "expected_split", "read_exr", "render_job"]

MARGIN = 3  # columns on each side that the divider's line covers


def read_exr(url: str, folder: Path) -> np.ndarray:
    """Downloads an EXR from the service, and returns its colour, (h, w, 3) float32. folder: for the downloaded file."""
    path = folder / "film.exr"
    path.write_bytes(httpx.get(url).raise_for_status().content)
    picture = OpenImageIO.ImageInput.open(str(path))
    assert picture, OpenImageIO.geterror()
    pixels: np.ndarray = picture.read_image(0, 0, 0, 3, OpenImageIO.FLOAT)
    return pixels


def expected_pixels(film: np.ndarray, exposure: float, curve: str) -> np.ndarray:
    """Returns the pixels that the page should display for a film, (h, w, 3) int from 0 to 255.

    The film's colours are rounded to RGB9E5, then exposure and tone curve are applied. exposure: in stops.
    """
    return tonemap.apply(rgbe9995.unpack(rgbe9995.pack(film)), exposure, curve).astype(int)


def _one_to_one(page: Page) -> tuple[float, float]:
    """Waits until the picture is drawn at 1:1; returns the position (x, y) of its corner on the stage, in CSS pixels."""
    stage = page.locator(".stage")
    expect(stage).to_have_attribute("data-view", re.compile("^1 "))
    _, x, y = (float(v) for v in (stage.get_attribute("data-view") or "").split())
    return x, y


def on_screen(page: Page, width: int, height: int) -> np.ndarray:
    """Returns the pixels of the picture as displayed at 1:1, (h, w, 3) uint8.

    They are read from a screenshot, since WebGL's readPixels may return nothing.
    """
    x, y = _one_to_one(page)
    box = page.locator("canvas.film").bounding_box()
    assert box is not None
    clip = {"x": box["x"] + x, "y": box["y"] + y, "width": width, "height": height}
    return np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB"))


def assert_screen(page: Page, wanted: np.ndarray, what: str) -> np.ndarray:
    """Waits until the screen shows the picture `wanted`, and returns the screenshot; fails otherwise.

    Each value may differ by one 8-bit step; pixels with negative values in `wanted` are not compared. The software renderer draws
    a frame in tens of milliseconds, the first one in seconds.
    """
    height, width = wanted.shape[:2]
    seen = wanted >= 0
    deadline = time.monotonic() + 15
    while True:
        screen = on_screen(page, width, height)
        difference = np.abs(screen.astype(int) - wanted)[seen].max()
        if difference <= 1 or time.monotonic() > deadline:
            break
        page.wait_for_timeout(100)  # each screenshot draws everything again, on the processor that the page needs
    assert difference <= 1, f"{what} differs by {difference}/255"
    return screen


def assert_shows(page: Page, film: np.ndarray, exposure: float, curve: str) -> np.ndarray:
    """Asserts that the screen shows this film as computed by `expected_pixels`; returns the screenshot.

    exposure: in stops. curve: name of the tone curve.
    """
    return assert_screen(page, expected_pixels(film, exposure, curve), f"{curve} at {exposure:+} EV")


def render_job(farm: Farm, scene: str, **request: Any) -> str:
    """Renders a job of the scene, waits until it is finished, and returns its id."""
    with farm.client() as client:
        job = client.submit(scene, **request).id
        wait_until(lambda: client.job(job).state == "finished", 180, "the job is finished")
    return job


def expected_split(left: np.ndarray, right: np.ndarray, page: Page) -> np.ndarray:
    """Returns the expected display of a comparison: `left` before the divider, `right` after it.

    The divider is at its current position on the page; pixels that it covers are -1, which `assert_screen` ignores.
    """
    x, y = _one_to_one(page)
    stage, divider = page.locator(".stage").bounding_box(), page.get_by_role("slider", name="Wipe").bounding_box()
    assert stage and divider
    column = round(divider["x"] + divider["width"] / 2 - stage["x"] - x)
    wanted = np.concatenate([left[:, :column], right[:, column:]], axis=1)
    wanted[:, max(column - MARGIN, 0) : column + MARGIN] = -1
    grip = 26  # including its focus ring
    middle = round(stage["height"] / 2 - y)
    wanted[middle - grip : middle + grip, max(column - grip, 0) : column + grip] = -1
    return wanted
