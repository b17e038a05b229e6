"""Tests of the notebook widget that shows a job: its Python part with a real farm, its JavaScript part in a real browser."""

from __future__ import annotations

import numpy as np
import pytest
from playwright.sync_api import Page, expect

import rayfarm
from rayfarm.client import Client
from renderer.image import rgbe9995, tonemap
from tests.helpers import ROOT, Farm, wait_until

CORNELL = ROOT / "scenes" / "cornell-box.yaml"


@pytest.mark.long
def test_notebook_widget_shows_job(farm: Farm, page: Page) -> None:
    with Client(farm.url) as client:
        scene = client.wait_for_scene(client.upload([CORNELL]).id)
        job = client.submit(scene.id, width=48, height=32, spp=8, max_depth=4)
        assert "application/vnd.jupyter.widget-view+json" in job._repr_mimebundle_()[0]
        widget = rayfarm.show(job, farm=client)
        image = widget.wait()
    assert image.is_final and widget.is_over and widget.progress == 1
    state = {name: getattr(widget, name) for name in ("width", "height", "exposure", "status", "progress", "is_over")}
    page.set_content("<body style='margin:0;width:480px'><div id='cell'></div></body>")
    page.evaluate(
        """async ({ source, state, pixels }) => {
            const module = await import(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
            const heard = {};
            const bytes = Uint8Array.from(pixels);
            const values = { ...state, pixels: new DataView(bytes.buffer) };
            const model = {
                get: (name) => values[name],
                set: (name, value) => { values[name] = value; heard[`change:${name}`]?.(); },
                save_changes: () => {},
                on: (event, f) => { heard[event] = f; },
                off: (event) => { delete heard[event]; },
            };
            window.leave = module.default.render({ model, el: document.getElementById("cell") });
            window.heard = heard;
        }""",
        {
            "source": (ROOT / "rayfarm" / "library" / "notebook_widget.js").read_text(),
            "state": state,
            "pixels": list(widget.pixels),
        },
    )
    expect(page.locator(".status")).to_have_text(widget.status)
    assert widget.status.startswith("48 × 32, 8 samples per pixel")
    light = rgbe9995.unpack(rgbe9995.pack(image["color"]))

    def assert_shown(exposure: float) -> None:
        wanted = tonemap.apply(light, exposure).astype(int)
        read = """() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
            const c = document.querySelector('canvas');
            done([...c.getContext('2d').getImageData(0, 0, c.width, c.height).data]);
        })))"""
        found = np.array(page.evaluate(read)).reshape(32, 48, 4)[..., :3]
        assert np.abs(found - wanted).max() <= 1

    assert_shown(0.0)
    page.get_by_label("Exposure").fill("1.5")
    assert_shown(1.5)
    canvas = page.get_by_role("img")
    whole = canvas.screenshot()
    canvas.focus()
    page.keyboard.press("+")
    wait_until(lambda: canvas.screenshot() != whole, 20, "it is nearer")
    page.get_by_role("button", name="Fit").click()
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] * 10.5 / 48, box["y"] + box["height"] * 20.5 / 32)
    values = " ".join(f"{v:.3g}" for v in light[20, 10])
    assert page.locator(".pixel").inner_text().startswith("10, 20: "), values
    found = [float(v) for v in page.locator(".pixel").inner_text().split(": ")[1].split()]
    np.testing.assert_allclose(found, light[20, 10], rtol=6e-3)
    page.evaluate("leave()")
    assert page.evaluate("Object.keys(heard).length") == 0
