"""Tests of pictures of high dynamic range on the page: its WebGPU canvas gets the values of a JPEG's gain map."""

from __future__ import annotations

import base64
import io
import shutil

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from renderer.image import rgbe9995, tonemap
from renderer.image.gain_map import OFFSET, highlight_stops
from tests.e2e.conftest import FLAGS
from tests.e2e.site import HEIGHT, WIDTH, Site, call, sample_radiance

WEBGPU = [
    *(flag for flag in FLAGS if not flag.startswith("--disable-gpu")),  # a WebGPU canvas needs the compositor's GPU process
    *("--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"),
    *("--enable-features=Vulkan", "--use-vulkan=swiftshader", "--ignore-gpu-blocklist"),
]
# As on a display of high dynamic range; and the bytes that the WebGPU canvas gets are kept.
DISPLAY = """
    const plain = window.matchMedia.bind(window);
    window.matchMedia = (query) =>
        query.includes("dynamic-range: high") ? { matches: true, addEventListener() {} } : plain(query);
    if (window.GPUQueue) {
        const { writeTexture } = GPUQueue.prototype;
        GPUQueue.prototype.writeTexture = function (to, data, layout, size) {
            window.written = { data: data.slice(), size, label: to.texture.format };
            return writeTexture.call(this, to, data, layout, size);
        };
    }"""
MOUNT = """
    const view = new m.FilmView(a.width, a.height, { cursor() {}, moved() {} });
    document.body.replaceChildren(view.element);
    Object.assign(document.body.style, { margin: 0, height: "100vh" }); // the canvases fill the parent of the stage
    Object.assign(view.element.style, { position: "fixed", inset: 0 });
    for (const canvas of view.element.children) canvas.style.position = "absolute";
    const { Film } = await import("/js/film/film.js");
    view.layers[0].setFilm(new Film(a.width, a.height, new Uint32Array(a.words)));
    view.canvas.resize();
    view.actualSize();
    window.view = view;
    view.setLook({ exposure: 0, curve: "neutral", high: true });
    for (let i = 0; i < 100 && !view.canvas.high; i++) await new Promise((done) => setTimeout(done, 100));
    const high = view.canvas.high;
    if (!high) return null;
    high.canvas.style.position = "absolute";
    view.canvas.resize();
    return high.context.getConfiguration().toneMapping.mode;"""
READ = """async (look) => {
    view.setLook({ ...look, high: true });
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    const { data, size, label } = window.written;
    const bytes = new Uint8Array(data.buffer);
    let text = "";
    for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
    return { bytes: btoa(text), size, label, x: view.viewport.x, y: view.viewport.y };
}"""


def expected(film: np.ndarray, exposure: float, curve: str) -> np.ndarray:
    """Returns the linear values of the rendition of high dynamic range, (h, w, 3)."""
    shown = tonemap.apply(film, exposure, curve)
    linear = tonemap.decode_srgb(shown.astype(np.float64) / 255)
    gain = np.exp2(highlight_stops(film, shown, exposure, curve))[..., None]
    return (linear + OFFSET) * gain - OFFSET


@pytest.mark.long
def test_high_range_canvas_has_values_of_gain_map(browser: Browser, site: Site) -> None:
    """The values are those of a saved JPEG with a gain map, above 1 too; and what is below white is seen on any display."""
    chromium = browser.browser_type.launch(executable_path=shutil.which("chromium"), args=WEBGPU)
    try:
        page: Page = chromium.new_page(viewport={"width": 200, "height": 160})
        page.add_init_script(DISPLAY)
        page.goto(f"{site.url}/blank")
        film = sample_radiance()
        words = rgbe9995.pack(film)
        mode = call(page, "film/film-view", MOUNT, {"width": WIDTH, "height": HEIGHT, "words": words.ravel().tolist()})
        if mode is None:
            pytest.skip("this browser has no WebGPU adapter")
        assert mode == "extended"
        expect(page.locator("canvas.high-range")).to_have_count(1)
        seen = rgbe9995.unpack(words)
        for exposure, curve in ((0.0, "neutral"), (-2.0, "srgb"), (1.5, "filmic")):
            found = page.evaluate(READ, {"exposure": exposure, "curve": curve})
            assert found["label"] == "rgba16float"
            width, height = found["size"]
            x, y = round(found["x"]), round(found["y"])
            halves = np.frombuffer(base64.b64decode(found["bytes"]), np.float16).reshape(height, width, 4).astype(np.float64)
            assert not halves[:, : x - 1].any(), "it is transparent beside the picture"
            got = halves[y : y + HEIGHT, x : x + WIDTH]
            assert (got[..., 3] == 1).all()
            linear = tonemap.decode_srgb(got[..., :3])
            np.testing.assert_allclose(linear, expected(seen, exposure, curve), rtol=0.03, atol=0.02)
            assert linear.max() > 3, "brighter than white"
        page.wait_for_timeout(200)
        clip = {"x": x, "y": y, "width": WIDTH, "height": HEIGHT}
        screen = np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB")).astype(int)
        dark = expected(seen, exposure, curve).max(-1) < 0.1
        assert np.abs(screen - tonemap.apply(seen, exposure, curve).astype(int))[dark].max() <= 3
        page.evaluate("view.setLook({ exposure: 0, curve: 'neutral', high: false })")
        expect(page.locator("canvas.high-range")).to_have_count(0)
    finally:
        chromium.close()
