"""What a screen shows of a film, and what it should."""

from __future__ import annotations

import io
import time
from pathlib import Path

import httpx
import numpy as np
import OpenImageIO
from PIL import Image
from playwright.sync_api import Page

from renderer.image import rgbe9995, tonemap

__all__ = ["assert_screen", "assert_shows", "read_exr", "shown"]


def read_exr(url: str, folder: Path) -> np.ndarray:
    """The colour of an EXR that the service gives, (h, w, 3) float32."""
    path = folder / "film.exr"
    path.write_bytes(httpx.get(url).raise_for_status().content)
    picture = OpenImageIO.ImageInput.open(str(path))
    assert picture, OpenImageIO.geterror()
    pixels: np.ndarray = picture.read_image(0, 0, 0, 3, OpenImageIO.FLOAT)
    return pixels


def shown(film: np.ndarray, exposure: float, curve: str) -> np.ndarray:
    """A film as the page has it (RGB9E5), through exposure and curve: (h, w, 3) int."""
    return tonemap.apply(rgbe9995.unpack(rgbe9995.pack(film)), exposure, curve).astype(int)


def on_screen(page: Page, width: int, height: int) -> np.ndarray:
    """The picture's pixels on the screen at one to one, (h, w, 3) uint8. WebGL's own readPixels may be empty."""
    box = page.locator("canvas.film").bounding_box()
    scale, x, y = (float(v) for v in (page.locator(".stage").get_attribute("data-view") or "").split())
    assert box is not None and scale == 1
    clip = {"x": box["x"] + x, "y": box["y"] + y, "width": width, "height": height}
    return np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB"))


def assert_screen(page: Page, wanted: np.ndarray, what: str) -> np.ndarray:
    """The screen shows this picture, to a last bit of 8, wherever it is not negative. Gives the screen.

    The software renderer draws a frame in some tens of milliseconds: it has a few seconds.
    """
    height, width = wanted.shape[:2]
    seen = wanted >= 0
    deadline = time.monotonic() + 5
    while True:
        screen = on_screen(page, width, height)
        difference = np.abs(screen.astype(int) - wanted)[seen].max()
        if difference <= 1 or time.monotonic() > deadline:
            break
    assert difference <= 1, f"{what} differs by {difference}/255"
    return screen


def assert_shows(page: Page, film: np.ndarray, exposure: float, curve: str) -> np.ndarray:
    """The screen shows the film, as RGB9E5 carries it, through exposure and curve. Gives the screen."""
    return assert_screen(page, shown(film, exposure, curve), f"{curve} at {exposure:+} EV")
