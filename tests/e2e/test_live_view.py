"""Tests of a scene's live view: the arithmetic of its camera, and a farm that renders what the camera sees during navigation."""

from __future__ import annotations

import re

import httpx
import psutil
import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect

from renderer.denoise import is_available
from tests.e2e.conftest import SOON_CLEAR, Watched
from tests.helpers import Farm, wait_until


def slots_of(farm: Farm) -> list[psutil.Process]:
    """Returns the processes of the farm's slots."""

    def is_worker(process: psutil.Process) -> bool:
        try:
            return process.cmdline()[1:3] == ["-m", "worker.standby"]
        except psutil.NoSuchProcess:  # has just ended
            return False

    (worker,) = filter(is_worker, psutil.Process(farm.process.pid).children())
    return worker.children()


def stored_names(farm: Farm) -> tuple[set[str], set[str], set[str]]:
    """Returns the names of everything that the farm stores: (ids of jobs, file names of films, file names of blobs)."""
    jobs = {job["id"] for job in httpx.get(f"{farm.url}/api/jobs", params={"limit": 1000}).json()}
    films = {path.name for path in (farm.data / "films").iterdir()}
    return jobs, films, {path.name for path in (farm.data / "blobs").rglob("*") if path.is_file()}


class LiveView:
    """Opens the live view of the example scene "spheres" in a page, and records the view's WebSockets."""

    def __init__(self, farm: Farm, watched: Watched) -> None:
        scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
        with farm.client() as client:
            client.wait_for_scene(scene)
        address = f"{farm.url}/api/scenes/{scene}"
        wait_until(lambda: httpx.get(address).json()["thumbnail"] is not None, 60, "the scene has a thumbnail")
        self.kept = stored_names(farm)
        self.sockets: list[WebSocketRoute] = []
        self.page = watched.page
        self.page.set_viewport_size(
            {"width": 800, "height": 480}
        )  # a smaller view: rendering and drawing take most of these tests' time
        self.page.route_web_socket("**/viewport", self.through)
        self.page.goto(f"{farm.url}/#/scenes/{scene}")
        self.surface = self.page.locator(".live-view")
        wait_until(lambda: self.samples() >= 2, 120, "the view clears up without a press of a button")

    def through(self, socket: WebSocketRoute) -> None:
        self.sockets.append(socket)
        socket.connect_to_server()

    def address(self) -> str:
        return str(self.page.evaluate("location.href"))  # a call to the browser, which processes its events

    def samples(self) -> int:
        return int(self.surface.get_attribute("data-samples") or 0)

    def number(self) -> int:
        """Returns the number of the requested view whose picture is displayed; each camera movement requests a new view."""
        return int(self.surface.get_attribute("data-view") or 0)

    def turn(self) -> None:
        """Drags with the mouse, which rotates the view."""
        first = self.number()
        box = self.surface.bounding_box()
        assert box
        self.page.mouse.move(box["x"] + 100, box["y"] + 100)
        self.page.mouse.down()
        self.page.mouse.move(box["x"] + 180, box["y"] + 120, steps=4)
        self.page.mouse.up()
        expect(self.page.get_by_label("Camera", exact=True)).to_have_value("\0view")
        wait_until(lambda: self.number() > first, 60, "the turned view is seen")
        wait_until(lambda: "view=" in self.address(), 20, "the address says the view")


def test_live_view_stores_a_poster_at_most(farm: Farm, watched: Watched) -> None:
    view = LiveView(farm, watched)
    page = view.page
    expect(page.locator(".view-state")).to_contain_text(re.compile(r"\d samples?"))

    view.turn()
    eye = page.get_by_label("Eye x")

    def is_told() -> bool:
        x = float(view.address().split("view=")[1].split("_")[0])
        return bool(float(eye.input_value()) == pytest.approx(x, rel=1e-4))

    wait_until(is_told, 20, "the form and the address agree")

    page.close()  # closed without leaving the view
    wait_until(lambda: "views" not in farm_views(farm), 60, "the slots are let go")
    jobs, films, blobs = stored_names(farm)
    assert (jobs, films) == view.kept[:2], "no job, no film"
    assert len(blobs ^ view.kept[2]) <= 1, "no blob but the scene's poster, if the view was clear enough"
    assert [error for error in watched.errors if "WebSocket" not in error] == []


@pytest.mark.long
def test_live_view_navigates_and_survives_killed_slot(farm: Farm, watched: Watched) -> None:
    view = LiveView(farm, watched)
    page, surface = view.page, view.surface
    number, samples = view.number(), view.samples()
    size = page.get_by_role("radiogroup", name="Size")
    size.get_by_role("radio", name="Custom").check(force=True)
    wait_until(lambda: view.samples() > samples, 60, "the same numbers do not begin the view anew")
    assert view.number() == number
    page.evaluate("scrollTo(0, 0)")
    view.turn()
    link = view.address()
    surface.focus()
    page.keyboard.down("w")
    wait_until(lambda: view.address() != link, 20, "W flies")
    page.keyboard.up("w")
    page.evaluate("(link) => { location.hash = link.split('#')[1]; }", link)
    wait_until(lambda: view.address() == link, 20, "the address of another view shows that at once")

    slots_of(farm)[0].kill()
    view.sockets[-1].close(code=1011)
    wait_until(lambda: bool(view.address()) and len(view.sockets) == 2, 60, "it connects again by itself")
    number = view.number()
    wait_until(lambda: view.number() > number or view.samples() >= 1, 60, "and goes on")
    wait_until(lambda: view.samples() >= 2, 60, "with a slot that was killed and came back")

    page.get_by_role("button", name="Pick the focus").click()
    box = surface.bounding_box()
    assert box
    surface.click(position={"x": box["width"] / 2, "y": 0.9 * box["height"]})
    focus = page.get_by_label("Focus distance")
    expect(focus).not_to_have_value("")
    assert 2 < float(focus.input_value()) < 20, "the floor, between the camera and the spheres"
    hint = page.locator(".view-hint")
    expect(hint).to_contain_text("Set an aperture")
    page.get_by_label("f-number").fill("1.4")
    expect(hint).not_to_contain_text("Set an aperture")
    assert float(page.get_by_label("Aperture").input_value()) > 0
    assert [error for error in watched.errors if "WebSocket" not in error] == []


def farm_views(farm: Farm) -> str:
    """Returns "views" if a slot of the farm is rendering a live view, otherwise an empty string."""
    return "views" if any("view" in doing for w in httpx.get(f"{farm.url}/api/workers").json() for doing in w["current"]) else ""


@pytest.mark.long
def test_one_finger_scrolls_page_on_phone(farm: Farm, browser: Browser) -> None:
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

    def rests_at_the_top() -> bool:  # momentum moves the view for a while
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


@pytest.mark.long
def test_viewers_see_and_follow_each_other(farm: Farm, browser: Browser, watched: Watched) -> None:
    view = LiveView(farm, watched)
    context = browser.new_context(viewport={"width": 1100, "height": 600})
    context.add_init_script(SOON_CLEAR)
    context.add_init_script("localStorage['rayfarm.author'] = 'Ben'")
    ben = context.new_page()
    ben.goto(view.page.url)
    view.page.get_by_role("button", name="Follow Ben").click()
    box = ben.locator(".live-view").bounding_box()
    assert box
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    ben.mouse.move(x, y)
    ben.mouse.down()
    ben.mouse.move(x + 60, y - 20, steps=4)
    ben.mouse.up()
    ben.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.75 * box["height"])
    wait_until(lambda: has_own_view(ben), 60, "the address is that of the drag's end, and not of its middle")
    turned = ben.evaluate("location.href").partition("view=")[2]
    expect(view.page).to_have_url(re.compile(f"view={re.escape(turned)}"), timeout=60_000)
    expect(view.page.locator(".view-cursor")).to_have_text("Ben")

    def is_at_place() -> bool:
        own, cursor = view.surface.bounding_box(), view.page.locator(".view-cursor").bounding_box()
        if not own or not cursor:  # it is drawn anew with each message
            return False
        place = (cursor["x"] - own["x"]) / own["width"], (cursor["y"] - own["y"]) / own["height"]
        return place == pytest.approx((0.25, 0.75), abs=0.02)

    wait_until(is_at_place, 60, "the cursor is at the same place of the picture")
    view.surface.focus()
    view.page.keyboard.press("ArrowLeft")
    expect(view.page.get_by_role("button", name="Follow Ben")).to_be_visible()
    expect(view.page.locator(".view-cursor")).to_have_count(0)
    takes_are_shared_and_restored(view, ben, turned)
    context.close()
    expect(view.page.locator(".view-person")).to_have_count(0)
    assert watched.errors == []


def has_own_view(page: Page) -> bool:
    """Returns whether the address, which is written at most every 400 ms, has the view of the form."""
    _, _, view = page.evaluate("location.href").partition("view=")
    eye = [float(page.get_by_label(f"Eye {axis}").input_value()) for axis in "xyz"] if view else []
    return bool(view) and [float(value) for value in view.partition("*")[0].split("_")] == pytest.approx(eye, rel=1e-4, abs=1e-6)


def takes_are_shared_and_restored(view: LiveView, ben: Page, turned: str) -> None:
    """Ben saves a take in another light; the other's page shows it at once, restores it, and renames and deletes it."""
    page, exposure = view.page, view.page.get_by_label("Exposure in stops")
    ben.get_by_role("radio", name="Overcast").check(force=True)
    ben.get_by_label("Exposure in stops").fill("1.5")
    ben.get_by_role("button", name="Save take").click()
    tile = page.get_by_role("button", name=re.compile("^Take 1, Ben"))
    expect(tile).to_be_visible()
    expect(tile.locator("img")).to_be_visible()
    expect(page).not_to_have_url(re.compile(re.escape(turned)))
    assert exposure.input_value() == "0"
    tile.click()
    expect(page).to_have_url(re.compile(f"view={re.escape(turned)}&take="))
    expect(tile).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_role("radio", name="Overcast")).to_be_checked()
    assert exposure.input_value() == "1.5"
    view.surface.focus()
    page.keyboard.press("ArrowLeft")
    expect(tile).to_have_attribute("aria-pressed", "false")
    tile.focus()
    page.keyboard.press("F2")
    page.get_by_label("Name of the take").fill("Low light")
    page.keyboard.press("Enter")
    theirs = ben.get_by_role("button", name=re.compile("^Low light, Ben"))
    expect(theirs).to_be_visible()
    page.keyboard.press("Delete")
    expect(page.get_by_role("region", name="Takes")).to_be_hidden()
    page.keyboard.press("z")
    expect(page.get_by_role("button", name=re.compile("^Low light"))).to_be_visible()


# Collects the words over the view, and of the frames the exposure and whether the own picture is held back, as they change.
SAID = """() => {
    const [state, exposure] = [".view-state", ".view-exposure .number"].map((each) => document.querySelector(each));
    window.said = [];
    window.exposed = [];
    const all = { childList: true, characterData: true, subtree: true };
    new MutationObserver(() => said.push(state.textContent)).observe(state, all);
    const look = () => {
        const [before, held] = exposed.at(-1) ?? [];
        const now = [exposure.textContent, document.querySelector(".live-view canvas.held-back") !== null];
        if (now[0] !== before || now[1] !== held) exposed.push(now);
        requestAnimationFrame(look);
    };
    look();
}"""


@pytest.mark.long
@pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")
def test_live_view_is_denoised_and_can_show_its_noise(farm: Farm, watched: Watched) -> None:
    watched.page.add_init_script("try { localStorage['rayfarm-view-denoise'] = 'on'; } catch { /* no origin */ }")
    view = LiveView(farm, watched)
    expect(view.surface).to_have_attribute("data-denoised", "true", timeout=60_000)
    switch = view.page.get_by_role("button", name="Denoise", exact=True)
    expect(switch).to_have_attribute("aria-pressed", "true")
    held = view.page.locator(".live-view canvas.held-back")
    expect(held).to_have_count(0, timeout=60_000)
    expect(view.page.locator(".live-view canvas.mesh")).to_be_hidden()
    view.surface.focus()
    view.page.evaluate(SAID)
    view.page.keyboard.press("ArrowLeft")
    expect(held).to_have_count(1)  # the picture is shown on the mesh, and not the noise of the next one
    expect(view.page.locator(".live-view canvas.mesh")).to_be_visible()
    expect(held).to_have_count(0, timeout=60_000)
    assert "Preview, rendering …" in view.page.evaluate("said"), "a preview is named as such"
    expect(view.surface).to_have_attribute("data-denoised", "true")
    shown = view.number()
    view.sockets[-1].close(code=1011)
    wait_until(lambda: view.number() > shown, 60, "it connects again by itself, and the view is rendered again")
    expect(held).to_have_count(0, timeout=60_000)
    expect(view.surface).to_have_attribute("data-denoised", "true", timeout=60_000)
    view.page.keyboard.press("ArrowLeft")
    expect(held).to_have_count(1)  # the picture of the new connection is kept, too
    expect(held).to_have_count(0, timeout=60_000)
    view.page.evaluate("said.splice(0)")
    for light, words in (("Overcast", "Preview, rendering …"), ("Clear sky", "New light: rendering …")):
        view.page.get_by_text(light, exact=True).first.click()
        # The mesh shows the first light at once, and the picture in the old light precedes the second.
        expect(held).to_have_count(1)
        expect(held).to_have_count(0, timeout=60_000)
        expect(view.page.locator(".view-state")).to_have_text(re.compile(r"^\d+ samples, denoised"), timeout=60_000)
        said = view.page.evaluate("said.splice(0)")
        assert words in said, f"and no count of the view before: {said}"
        frames = view.page.evaluate("exposed.splice(0)")
        assert frames[-2][1] and not frames[-1][1], f"the picture in the new light is exposed when it is shown: {frames}"
    first = view.number()
    switch.click()
    expect(switch).to_have_attribute("aria-pressed", "false")
    wait_until(lambda: view.number() > first, 60, "it is rendered again")
    expect(view.surface).to_have_attribute("data-denoised", "false")
    assert watched.errors == []
