"""The live view of a scene: the arithmetic of turning, and a farm that follows the hand."""

from __future__ import annotations

import math
import re

import httpx
import numpy as np
import psutil
import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect

from renderer.image import rgbe9995
from renderer.settings import Tile
from service.viewing.view_packet import EXACT, Shown, packet
from tests.e2e.conftest import SOON_CLEAR, Watched
from tests.e2e.site import call
from tests.helpers import Farm, wait_until
from tests.service.viewer import body_of, unpacked

VIEW = {"eye": [3, 2, 5], "target": [0.5, 1, -1], "up": [0, 1, 0], "fov": 40}


def vector(view: dict[str, list[float]], name: str) -> np.ndarray:
    return np.array(view[name])


def test_turning_keeps_the_target_and_its_distance(page: Page) -> None:
    distance = np.linalg.norm(vector(VIEW, "eye") - vector(VIEW, "target"))
    for dx, dy in ((0.3, 0), (0, 0.4), (-2, -0.5), (0.1, 9)):
        turned = call(page, "scene/orbit", f"return m.orbit(a, {dx}, {dy});", VIEW)
        assert turned["target"] == VIEW["target"]
        offset = vector(turned, "eye") - vector(turned, "target")
        assert np.linalg.norm(offset) == pytest.approx(distance)
        assert abs(offset[1]) <= math.sin(math.radians(89.001)) * distance, "never along up"
    back = call(page, "scene/orbit", "return m.orbit(m.orbit(a, 0.7, 0.2), -0.7, -0.2);", VIEW)
    np.testing.assert_allclose(back["eye"], VIEW["eye"], atol=1e-12)


def test_what_is_dragged_follows_the_hand(page: Page) -> None:
    """Half a picture's height to the right and down: the old target is seen there."""
    moved = call(page, "scene/orbit", "return m.pan(a, 0.5, 0.25);", VIEW)
    forward = vector(moved, "target") - vector(moved, "eye")
    distance = np.linalg.norm(forward)
    right = np.cross(forward, VIEW["up"])
    right /= np.linalg.norm(right)
    above = np.cross(right, forward / distance)
    seen = vector(VIEW, "target") - vector(moved, "target")
    height = 2 * distance * math.tan(math.radians(VIEW["fov"] / 2))  # type: ignore[operator]
    np.testing.assert_allclose([seen @ right / height, seen @ above / height, seen @ forward], [0.5, -0.25, 0], atol=1e-9)


def test_a_pixels_depth_along_the_line_of_sight(page: Page) -> None:
    body = "return m.alongSight(a, { width: 300, height: 200 }, { x: 299, y: 0 }, 7);"
    half = math.tan(math.radians(20))
    direction = np.array([299 / 200 * half, 199 / 200 * half, 1])
    assert call(page, "scene/orbit", body, VIEW) == pytest.approx(7 / np.linalg.norm(direction))
    direction += np.array([2 * 0.5, 2 * 0.25, 0]) * half  # of a lens that is shifted right, and up
    shifted = {**VIEW, "shift_x": 0.5, "shift_y": 0.25}
    assert call(page, "scene/orbit", body, shifted) == pytest.approx(7 / np.linalg.norm(direction))


def test_flying_moves_eye_and_target_along_the_cameras_axes(page: Page) -> None:
    moved = call(page, "scene/orbit", "return m.fly(a, 0, 2, 3);", VIEW)
    forward = vector(VIEW, "target") - vector(VIEW, "eye")
    way = np.array([0, 2, 0]) + 3 * forward / np.linalg.norm(forward)
    np.testing.assert_allclose(vector(moved, "eye") - vector(VIEW, "eye"), way, atol=1e-12)
    np.testing.assert_allclose(vector(moved, "target") - vector(VIEW, "target"), way, atol=1e-12)


def test_a_view_goes_through_the_url(page: Page) -> None:
    whole = {**VIEW, "projection": "perspective"}
    other = {**whole, "up": [0, 0, 1], "aperture": 0.02, "focus": 5.3, "projection": "orthographic", "height": 2.5, "near": 0.1}
    shifted = {**whole, "shift_x": 0.25, "shift_y": -0.5}
    body = "return a.map((view) => m.viewFromText(new URLSearchParams({ v: m.viewToText(view) }).get('v')));"
    assert call(page, "scene/view-url", body, [whole, other, shifted]) == [whole, other, shifted]
    bad = [None, "", "1_2_3", "1_2_3*1_2_3*40", "1_2_x*0_0_0*40", "1_2_3*0_0_0*400", "1__3*0_0_0*40", "<script>"]
    assert call(page, "scene/view-url", "return a.map(m.viewFromText);", bad) == [None] * len(bad)


def test_a_small_picture_is_made_large_smoothly(page: Page) -> None:
    small = np.random.default_rng(3).uniform(0.1, 4.0, (3, 4, 3)).astype(np.float32)
    body = """
        const { Film } = await import('/js/film/film.js');
        return [...m.enlarged(new Film(4, 3, new Uint32Array(a.words)), a.w, a.h).words];"""
    words = rgbe9995.pack(small)
    for w, h in ((4, 3), (13, 9)):
        large = np.array(call(page, "scene/enlarge", body, {"words": words.ravel().tolist(), "w": w, "h": h}), np.uint32)
        y = np.clip((np.arange(h) + 0.5) * 3 / h - 0.5, 0, 2)
        x = np.clip((np.arange(w) + 0.5) * 4 / w - 0.5, 0, 3)
        hat_y = np.maximum(0, 1 - abs(y[:, None] - np.arange(3)))
        hat_x = np.maximum(0, 1 - abs(x[:, None] - np.arange(4)))
        expected = np.einsum("yi,xj,ijc->yxc", hat_y, hat_x, rgbe9995.unpack(words))
        found = rgbe9995.unpack(large.reshape(h, w))
        np.testing.assert_allclose(found, expected, atol=expected.max() * 2**-9)


def test_a_picture_of_the_view_is_unpacked_as_it_was_packed(page: Page) -> None:
    generator = np.random.default_rng(5)
    rects = [Tile(0, 0, 9, 6), Tile(9, 0, 4, 6), Tile(0, 6, 9, 5), Tile(9, 6, 4, 5)]
    means = [2.0 ** generator.uniform(-20, 14, (3, rect.h, rect.w)).astype(np.float32) for rect in rects]
    tiles = [Shown(*each, number + 1, number % 2 == 1) for number, each in enumerate(zip(rects, means, strict=True))]
    message = packet(tiles, (13, 11), (26, 22), 7, 9)
    body = """
        const { id, seq, width, height, tiles } = await m.decodeView(new Uint8Array(a).buffer);
        return { about: [id, seq, width, height], tiles: tiles.map((each) => ({ ...each, words: [...each.words] })) };"""
    found = call(page, "scene/view-packet", body, list(message))
    assert found["about"] == [7, 9, 13, 11]
    heads = [(*tile.rect, tile.samples + tile.is_exact * EXACT) for tile in tiles]
    for tile, told, expected in zip(tiles, found["tiles"], unpacked(heads, body_of(message)), strict=True):
        assert [told[name] for name in ("x", "y", "w", "h", "spp", "isExact")] == [*tile.rect, tile.samples, tile.is_exact]
        words = np.array(told["words"], np.uint32).reshape(expected.shape)
        if tile.is_exact:
            np.testing.assert_array_equal(words, expected)
        else:
            ours, theirs = rgbe9995.unpack(expected), rgbe9995.unpack(words)
            assert (abs(theirs - ours) <= 2**-8 * ours.max(-1, keepdims=True)).all(), "but for how a half is rounded"


def slots_of(farm: Farm) -> list[psutil.Process]:
    """The processes that render."""

    def is_worker(process: psutil.Process) -> bool:
        try:
            return process.cmdline()[1:3] == ["-m", "worker"]
        except psutil.NoSuchProcess:  # one that has just ended
            return False

    (worker,) = filter(is_worker, psutil.Process(farm.process.pid).children())
    return worker.children()


def kept(farm: Farm) -> tuple[set[str], set[str], set[str]]:
    """Jobs, films and blobs."""
    jobs = {job["id"] for job in httpx.get(f"{farm.url}/api/jobs", params={"limit": 1000}).json()}
    films = {path.name for path in (farm.data / "films").iterdir()}
    return jobs, films, {path.name for path in (farm.data / "blobs").rglob("*") if path.is_file()}


def test_the_view_is_live_and_leaves_nothing_behind(farm: Farm, watched: Watched) -> None:
    page = watched.page
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    before = kept(farm)
    sockets: list[WebSocketRoute] = []

    def through(socket: WebSocketRoute) -> None:
        sockets.append(socket)
        socket.connect_to_server()

    page.route_web_socket("**/viewport", through)
    page.goto(f"{farm.url}/#/scenes/{scene}")
    surface = page.locator(".live-view")
    state = page.locator(".view-state")

    def address() -> str:
        return str(page.evaluate("location.href"))  # which lets the browser's news in

    def samples() -> int:
        return int(surface.get_attribute("data-samples") or 0)

    wait_until(lambda: samples() >= 2, 120, "the view clears up without a press of a button")
    expect(state).to_contain_text(re.compile(r"\d spp.*2 slots"))

    def view() -> int:
        return int(surface.get_attribute("data-view") or 0)  # the number of the one whose picture is shown

    first = view()
    box = surface.bounding_box()
    assert box
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 180, box["y"] + 120, steps=4)
    page.mouse.up()
    expect(page.get_by_label("Camera", exact=True)).to_have_value("\0view")
    wait_until(lambda: view() > first, 60, "the turned view is seen")
    wait_until(lambda: "view=" in address(), 20, "the address says the view")
    link = address()

    surface.focus()
    page.keyboard.down("w")
    wait_until(lambda: address() != link, 20, "W flies")
    page.keyboard.up("w")
    page.evaluate("(link) => { location.hash = link.split('#')[1]; }", link)
    wait_until(lambda: address() == link, 20, "the address of another view shows that at once")
    eye = page.get_by_label("Eye x")
    assert float(eye.input_value()) == pytest.approx(float(link.split("view=")[1].split("_")[0]), rel=1e-4)

    slots_of(farm)[0].kill()
    sockets[-1].close(code=1011)
    wait_until(lambda: bool(address()) and len(sockets) == 2, 60, "it connects again by itself")
    number = view()
    wait_until(lambda: view() > number or samples() >= 1, 60, "and goes on")
    wait_until(lambda: samples() >= 2, 60, "with a slot that was killed and came back")

    page.get_by_role("button", name="Keep this view").click()
    expect(page.get_by_role("button", name="View 1", exact=True)).to_be_visible()
    page.get_by_role("button", name="Pick the focus").click()
    surface.click(position={"x": box["width"] / 2, "y": 0.9 * box["height"]})
    focus = page.get_by_label("Focus distance")
    expect(focus).not_to_have_value("")
    assert 2 < float(focus.input_value()) < 20, "the floor, between the camera and the spheres"
    hint = page.locator(".view-hint")
    expect(hint).to_contain_text("Give the lens an aperture")
    page.get_by_label("f-number").fill("1.4")
    expect(hint).not_to_contain_text("Give the lens an aperture")
    assert float(page.get_by_label("Aperture").input_value()) > 0

    page.close()  # as one who leaves without a word
    wait_until(lambda: "views" not in farm_views(farm), 60, "the slots are let go")
    assert kept(farm) == before, "no job, no film, no blob"
    assert [error for error in watched.errors if "WebSocket" not in error] == []


def farm_views(farm: Farm) -> str:
    """What slots do now."""
    return "views" if any("view" in doing for w in httpx.get(f"{farm.url}/api/workers").json() for doing in w["current"]) else ""


@pytest.mark.long
def test_on_a_phone_the_page_scrolls_under_one_finger(farm: Farm, browser: Browser) -> None:
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    context = browser.new_context(viewport={"width": 375, "height": 700}, has_touch=True, is_mobile=True)
    context.add_init_script(SOON_CLEAR)
    page = context.new_page()
    page.goto(f"{farm.url}/#/scenes/{scene}")
    page.wait_for_selector(".live-view[data-view]", timeout=60_000)
    session = context.new_cdp_session(page)
    box = page.locator(".live-view").bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] - 10

    def drag() -> None:
        session.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
        for step in range(1, 12):
            session.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [{"x": x, "y": y - 9 * step}]})
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    drag()
    wait_until(lambda: page.evaluate("scrollY") > 20, 20, "the page scrolls")
    assert "view=" not in page.evaluate("location.href")

    def rests_at_the_top() -> bool:  # what was flung goes on for a while
        page.evaluate("scrollTo(0, 0)")
        page.wait_for_timeout(150)
        return page.evaluate("scrollY") == 0

    wait_until(lambda: rests_at_the_top() and rests_at_the_top(), 20, "the page rests")
    page.locator(".live-view").tap()
    expect(page.locator(".live-view")).to_have_class(re.compile("held"))
    drag()
    wait_until(lambda: "view=" in page.evaluate("location.href"), 20, "once it was tapped, the view turns")
    assert page.evaluate("scrollY") == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= 375
    context.close()
