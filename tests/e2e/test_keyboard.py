"""Tests that the page can be used by keyboard alone: an upload, a download, and a deletion that is undone."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Locator, Page, expect

from tests.e2e.conftest import Watched
from tests.e2e.screen import render_job
from tests.e2e.small_glb import small_glb
from tests.helpers import Farm

pytestmark = pytest.mark.long

MOST_STOPS = 80
# Whether the focused element is on screen, is covered by nothing, and has a visible focus mark on or around it.
VISIBLE = """(element) => {
    const {left, right, top, bottom} = element.getBoundingClientRect();
    const over = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    const label = element.closest("label") ?? element.parentElement;
    const above = [label.parentElement, label.parentElement?.parentElement];
    const near = [element, label, ...above, ...label.children, ...element.children];
    const isDrawn = near.some((each) => {
        const style = each && getComputedStyle(each);
        return style && ((style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0) || style.boxShadow !== "none");
    });
    const isThere = bottom > 0 && top < innerHeight && (label.contains(over) || element.contains(over));
    return element.matches(":focus-visible") && isDrawn && isThere;
}"""


def tab_to(page: Page, wanted: Locator) -> None:
    """Presses Tab until the element `wanted` has the focus.

    Fails if a focused element on the way does not show that it is focused.
    """
    wanted.wait_for()
    for _ in range(MOST_STOPS):
        page.keyboard.press("Tab")
        focused = page.evaluate_handle("document.activeElement").as_element()
        assert focused
        if focused.evaluate("(element) => element === document.body"):
            continue  # once per round the browser's own bar has the focus
        assert focused.evaluate(VISIBLE), focused.evaluate("(element) => element.outerHTML.slice(0, 200)")
        if wanted.evaluate("(element) => element === document.activeElement"):
            return
    raise AssertionError(f"Tab never reaches {wanted}")


def test_picture_can_be_rendered_by_keyboard_alone(farm: Farm, watched: Watched) -> None:
    page = watched.page
    keys = page.keyboard
    glb = {"name": "small.glb", "mimeType": "model/gltf-binary", "buffer": small_glb("keyboard")}
    page.on("filechooser", lambda chooser: chooser.set_files([glb]))
    page.goto(farm.url)
    tab_to(page, page.get_by_role("button", name="Choose files"))
    keys.press("Enter")
    expect(page.get_by_role("button", name="Render", exact=True)).to_be_visible()
    expect(page.get_by_role("main")).to_be_focused()
    scene = page.url.split("/scenes/")[1].split("?")[0]
    other = render_job(farm, scene, width=96, height=54, spp=4)

    camera = page.get_by_label("Camera", exact=True)
    tab_to(page, camera)
    for key in ("ArrowDown", "ArrowDown", "Enter"):  # opens the list, moves to the next entry, selects it
        keys.press(key)
    expect(camera).to_have_value("1")
    for group, field, number in (("Size", "Width", 96), ("Quality", "Samples per pixel", 2000)):
        tab_to(page, page.get_by_role("radiogroup", name=group).locator("input:checked"))
        while not page.get_by_role("radiogroup", name=group).locator("input").last.is_checked():
            keys.press("ArrowRight")
        tab_to(page, page.get_by_label(field, exact=True))
        keys.press("Control+a")
        keys.type(str(number))
    tab_to(page, page.get_by_role("button", name="Render", exact=True))
    keys.press("Enter")

    expect(page.get_by_label("Progress", exact=True).locator(".big")).to_have_text(re.compile("[1-9]"))
    expect(page.get_by_role("main")).to_be_focused()
    keys.press("p")
    tab_to(page, page.get_by_role("button", name="Resume"))
    keys.press("Enter")
    more = page.get_by_role("button", name="2,000 samples")
    expect(page.locator(".job-head")).to_contain_text("Finished", timeout=60_000)
    expect(more).to_be_focused()
    keys.press("Enter")
    expect(page.get_by_role("region", name="Progress")).to_contain_text("of 4,000 samples")
    expect(page.locator(".job-head")).to_contain_text("Finished", timeout=60_000)
    picture = page.url

    keys.press("c")
    wipe = page.get_by_role("slider", name="Wipe")
    expect(page.get_by_label("Picture B")).to_have_value(other)
    tab_to(page, wipe)
    before = wipe.get_attribute("aria-valuenow")
    keys.press("ArrowLeft")
    assert wipe.get_attribute("aria-valuenow") != before
    page.go_back()
    expect(page).to_have_url(picture)

    tab_to(page, page.get_by_role("tab", name="View"))
    for _ in ("Lights", "Notes", "Save"):
        keys.press("ArrowRight")
    tab_to(page, page.get_by_role("link", name="PNG", exact=True))
    with page.expect_download() as download:
        keys.press("Enter")
    assert np.asarray(Image.open(download.value.path())).shape[:2] == (54, 96)

    tab_to(page, page.get_by_role("button", name="Delete this picture"))
    keys.press("Enter")
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
    expect(page.get_by_role("main")).to_be_focused()
    link = page.locator(f"a.name[href='#/jobs/{picture.split('/jobs/')[1].split('?')[0]}']")
    expect(link).to_have_count(0)
    keys.press("z")
    tab_to(page, link)
    assert watched.errors == []
