"""Tests of the way from an upload to the first picture: something is seen and said in every frame."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Watched
from tests.e2e.small_glb import small_glb
from tests.helpers import Farm

# Looks at every frame: at the front page until it is left, at the scene's page until its view shows a picture.
# withoutSteps: a scene that waits for a worker has steps, but no current one.
# early: WebGL contexts created before the scene's page had been drawn.
# blank: the steps are folded before the scene is seen; in a single frame it may be drawn after this.
WATCH = """(() => {
  window.said = new Set();
  const seen = (window.seen = { frames: 0, faded: 0, withoutSteps: 0, silent: 0, early: 0, blank: 0 });
  let drawn = -1;
  let isOver = false;
  let wasBlank = false;
  const frame = () => document.querySelector(".scene-page .live-view-frame");
  const { getContext } = HTMLCanvasElement.prototype;
  HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    if (kind === "webgl2" && frame() && drawn < 1) seen.early++;
    return getContext.call(this, kind, ...rest);
  };
  const look = () => {
    const page = document.querySelector("#main > *");
    if (page && Number(getComputedStyle(page).opacity) < 1) seen.faded++;
    if (frame()) {
      drawn++;
      const view = document.querySelector(".live-view");
      const picture = view?.querySelector("canvas:not(.mesh)");
      isOver ||= Boolean(view?.dataset.view) && picture && !picture.classList.contains("held-back");
      const state = document.querySelector(".view-state");
      if (!isOver) {
        seen.frames++;
        if (!document.querySelector(".steps li")) seen.withoutSteps++;
        if (state && !state.textContent) seen.silent++;
        const isFolded = document.querySelector(".view-steps.folded");
        const isBlank = isFolded && !view.style.backgroundImage && !view.querySelector("canvas.mesh")?.dataset.drawn;
        if (isBlank && wasBlank) seen.blank++;
        wasBlank = isBlank;
        said.add(state?.textContent ?? "");
      }
    }
    requestAnimationFrame(look);
  };
  addEventListener("DOMContentLoaded", look);
})()"""


# Draws no frame from the upload until the scene is ready, as on a busy machine.
NO_FRAMES = """(() => {
  const next = requestAnimationFrame;
  const isReady = () => document.querySelector(".scene-page .live-view-frame") && !document.querySelector(".preparing-panel");
  const hold = (then) => next((now) => (window.isHeld && !isReady() ? hold(then) : then(now)));
  window.requestAnimationFrame = hold;
})()"""


@pytest.mark.long
@pytest.mark.parametrize("frames", ["", NO_FRAMES], ids=["usual", "late"])
def test_steps_are_seen_from_first_frame_of_scene_page_until_its_picture(farm: Farm, watched: Watched, frames: str) -> None:
    page = watched.page
    page.set_viewport_size({"width": 800, "height": 480})
    page.add_init_script(frames)
    page.add_init_script(WATCH)
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    page.evaluate("() => void (window.isHeld = true)")
    chooser.value.set_files(
        [{"name": "cube.glb", "mimeType": "model/gltf-binary", "buffer": small_glb(f"first picture {len(frames)}")}]
    )
    steps = page.locator(".view-pills > .view-steps")
    expect(steps.get_by_text("Upload")).to_be_attached()
    expect(steps).to_have_count(0, timeout=90_000)
    expect(page.locator(".live-view canvas").last).to_be_attached()
    seen = page.evaluate("seen")
    assert seen["frames"] > 0
    assert seen == {"frames": seen["frames"], "faded": 0, "withoutSteps": 0, "silent": 0, "early": 0, "blank": 0}
    words = page.evaluate("[...said]")
    assert any(each.startswith("Preview, rendering") for each in words), words  # as the list of steps is folded
    assert watched.errors == []


@pytest.mark.long
def test_mesh_before_samples_leaves_steps_to_line_and_shows_standard_views(farm: Farm, watched: Watched) -> None:
    """Once the mesh is seen, the steps are folded behind a button; a button or a key turns the view to a side."""
    page = watched.page
    page.route_web_socket("**/viewport", lambda socket: None)  # keeps samples from arriving
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    chooser.value.set_files([{"name": "cube.glb", "mimeType": "model/gltf-binary", "buffer": small_glb("standard views")}])
    steps = page.locator(".view-pills > .view-steps")
    expect(page.locator(".view-tool-bar")).to_be_visible(timeout=60_000)
    expect(steps.locator("summary")).to_be_visible(timeout=60_000)
    expect(steps.get_by_text("Upload")).to_be_hidden()
    steps.locator("summary").press("Enter")
    expect(steps.get_by_text("Upload")).to_be_visible()
    expect(page.get_by_role("button", name="Render", exact=True)).to_have_class(re.compile(r"\bprimary\b"))

    sides = page.get_by_role("group", name="Sides")
    camera = page.get_by_label("Camera", exact=True).locator("option:checked")
    pressed = sides.locator("[aria-pressed=true]")
    expect(pressed).to_have_count(0)
    sides.get_by_role("button", name="From the back").click()
    expect(camera).to_have_text("From the back")
    expect(pressed).to_have_accessible_name("From the back")
    for key, name in (("1", "From the front"), ("Shift+Digit3", "From the left"), ("7", "From above")):
        page.keyboard.press(key)
        expect(camera).to_have_text(name)
        expect(pressed).to_have_accessible_name(name)
    page.locator(".live-view").focus()
    page.keyboard.press("ArrowLeft")
    expect(pressed).to_have_count(0)
    expect(camera).to_have_text("Custom view …")
    page.keyboard.press("3")
    expect(pressed).to_have_accessible_name("From the right")
    page.wait_for_timeout(1000)  # for the address, which follows the view with a delay
    page.reload()
    expect(pressed).to_have_accessible_name("From the right")

    for width, height in ((1440, 900), (2560, 1300), (768, 1024), (375, 740)):
        page.set_viewport_size({"width": width, "height": height})
        pills, picture = page.locator(".view-pills").bounding_box(), page.locator(".live-view").bounding_box()
        assert pills and picture
        assert pills["y"] + pills["height"] <= picture["y"], f"the pills cover the picture at {width} pixels"
    assert watched.errors == []
