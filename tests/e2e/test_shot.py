"""Tests of the page of a shot: filmstrip, frame navigation by clicks and keys, playback, downloads, and changes."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Route, expect

from tests.e2e.conftest import Watched
from tests.e2e.screen import assert_shows, read_exr
from tests.e2e.site import WEB, call
from tests.helpers import Farm, wait_until
from tests.rayfarm.test_sequence import animated_scene

WIDTH, HEIGHT = 96, 64
# A shot of frames 0 to 1999, with the fields of its job that the page's modules read.
MANY = {"shot": {"frames": "0-1999", "count": 2000, "fps": 24}, "frames": []}


def upload_scene(farm: Farm, *files: tuple[str, bytes]) -> str:
    """Uploads a scene, and returns its id once it is ready."""
    parts = [("files", (name, content)) for name, content in files]
    scene: str = httpx.post(f"{farm.url}/api/scenes", files=parts).raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    return scene


def asked(farm: Farm, scene: str, **request: Any) -> str:
    """Submits a shot of the scene, and returns the job's id."""
    size = {"width": WIDTH, "height": HEIGHT, "environment": {"color": [1, 1, 1]}}
    job: str = httpx.post(f"{farm.url}/api/jobs", json={"scene": scene, **size, **request}).raise_for_status().json()["id"]
    return job


def job_json(farm: Farm, job: str) -> dict[str, Any]:
    found: dict[str, Any] = httpx.get(f"{farm.url}/api/jobs/{job}").raise_for_status().json()
    return found


def finished(farm: Farm, job: str) -> Callable[[], bool]:
    return lambda: bool(job_json(farm, job)["state"] == "finished")


def strip_cell(page: Page, number: int | float) -> Any:
    return page.get_by_role("option", name=re.compile(rf"^Frame {number}\b"))


def test_shot_is_rendered_played_and_downloaded(farm: Farm, watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    scene = upload_scene(farm, ("shot.glb", animated_scene().glb()))
    job = asked(farm, scene, frames="0-4", fps=16, spp=4)
    wait_until(finished(farm, job), 120, "the shot is finished")

    page.set_viewport_size({"width": 800, "height": 640})  # room for the whole picture above the filmstrip
    page.goto(f"{farm.url}/#/jobs/{job}")
    expect(page.get_by_role("region", name="Progress")).to_contain_text("of 5 frames")
    expect(page.locator(".frame-cell")).to_have_count(5)
    expect(strip_cell(page, 3)).to_have_accessible_name(re.compile("^Frame 3 finished"))
    expect(page.locator(".frame-picture img:visible")).to_have_count(5)
    films = {n: read_exr(f"{farm.url}/api/jobs/{job}/frames/{n}/image.exr", tmp_path) for n in (0, 3, 4)}
    assert np.abs(films[0] - films[3]).max() > 0.1, "the frames differ, or this test says nothing"

    def shows(number: int) -> None:
        expect(page.locator(".frame-number")).to_have_text(str(number))
        page.mouse.move(5, 5)
        assert_shows(page, films[number], 0, "neutral")

    page.keyboard.press("1")
    shows(0)
    strip_cell(page, 3).click()
    shows(3)
    expect(page).to_have_url(re.compile("frame=3"))
    page.keyboard.press("ArrowRight")
    shows(4)
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    expect(page).to_have_url(re.compile("frame=1"))

    # With in and out points, only frames between them are played and fetched.
    for _ in range(2):
        page.keyboard.press("Shift+ArrowRight")
    expect(page.locator(".part")).to_contain_text("1–3")
    page.keyboard.press("Space")
    expect(page.locator(".loaded")).to_contain_text("3 of 3 in memory")
    numbers: set[str] = set()

    def goes_on() -> bool:
        numbers.add(page.locator(".frame-number").inner_text())
        return len(numbers) >= 3

    wait_until(goes_on, 20, "it goes on")
    assert numbers <= {"1", "2", "3"}
    page.keyboard.press("Space")

    page.get_by_role("tab", name="Save").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="PNGs").click()
    assert download.value.suggested_filename == "shot.1-3.png.zip"
    with zipfile.ZipFile(download.value.path()) as archive:
        assert len(archive.namelist()) == 3
    page.keyboard.press("x")
    expect(page.locator(".part")).to_be_hidden()
    with page.expect_download() as download:
        page.get_by_role("link", name="MP4").click()
    assert download.value.suggested_filename == "shot.mp4"
    with av.open(str(download.value.path())) as movie:
        assert movie.streams.video[0].average_rate == 16
        assert len(list(movie.decode(video=0))) == 5
    assert watched.errors == []


@pytest.mark.long
def test_shot_opens_at_frame_and_is_extended(farm: Farm, watched: Watched) -> None:
    page = watched.page
    scene = upload_scene(farm, ("shot.glb", animated_scene().glb()))
    page.goto(f"{farm.url}/#/scenes/{scene}")
    page.get_by_text("Shot", exact=True).click()
    expect(page.get_by_label("Frames", exact=True)).to_have_value("0-24")
    job = asked(farm, scene, frames="0-7", fps=16, spp=4)
    wait_until(finished(farm, job), 120, "the shot is finished")

    page.goto(f"{farm.url}/#/jobs/{job}?frame=1")
    expect(strip_cell(page, 1)).to_have_attribute("aria-selected", "true")
    page.get_by_role("tab", name="Info").click()
    page.get_by_text("Change the shot").click()
    page.get_by_label("More frames").get_by_role("textbox").fill("8-9")
    page.get_by_role("form", name="More frames").get_by_role("button", name="Add").click()
    expect(page.locator(".frame-cell")).to_have_count(10)
    samples = page.get_by_role("form", name="More samples for frames")
    samples.get_by_role("textbox").fill("0-1")
    samples.get_by_label("Samples", exact=True).fill("4")
    samples.get_by_role("button", name="Add").click()
    expect(page.locator(".frame-bar.finished")).to_have_count(10, timeout=60_000)
    wait_until(finished(farm, job), 60, "the shot is finished again")
    spp = [frame["spp"] for frame in httpx.get(f"{farm.url}/api/jobs/{job}/frames").json()]
    assert spp == [8, 8, *[4] * 8]
    page.goto(f"{farm.url}/#/jobs")
    expect(page.get_by_text("frames 0-9 at 16 fps").first).to_be_visible()
    assert watched.errors == []


@pytest.mark.long
def test_failed_frame_is_shown_and_frame_is_prioritized(farm: Farm, watched: Watched) -> None:
    page = watched.page
    files = [(f"smoke.{n}.obj", f"v -9 -9 0\nv 9 -9 0\nv 0 {9 + n} 0\nf 1 2 3\n".encode()) for n in (0, 1, 3)]
    scene = upload_scene(farm, ("scene.yaml", b"shapes: [{type: mesh, file: smoke.#.obj}]\n"), *files)
    job = asked(farm, scene, frames="0-3", spp=1)
    wait_until(finished(farm, job), 120, "the others are finished")
    page.goto(f"{farm.url}/#/jobs/{job}")
    expect(strip_cell(page, 2)).to_have_accessible_name(re.compile(r"^Frame 2 failed: .*smoke"))
    strip_cell(page, 2).click()
    panel = page.get_by_role("region", name="Frame", exact=True)
    expect(panel).to_contain_text("smoke")
    page.get_by_role("tab", name="Info").click()
    expect(page.get_by_role("button", name="Try 1 failed frame again")).to_be_visible()
    expect(page.get_by_role("region", name="Progress")).to_contain_text("of 4 frames, 1 failed")

    page.get_by_role("button", name="Try this frame again").click()
    wait_until(lambda: job_json(farm, job)["shot"]["first"] == 2, 10, "it is tried first")
    expect(strip_cell(page, 2)).to_have_accessible_name(re.compile(r"^Frame 2 failed: .*smoke"), timeout=30_000)
    expect(page.get_by_role("alert").filter(visible=True)).to_have_count(0)

    other = asked(farm, scene, frames="0,1,3", spp=16000)
    httpx.patch(f"{farm.url}/api/jobs/{other}", json={"state": "paused"}).raise_for_status()
    page.goto(f"{farm.url}/#/jobs/{other}")
    strip_cell(page, 3).click()
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Rendered first")).to_be_disabled()
    assert job_json(farm, other)["shot"]["first"] == 3
    httpx.delete(f"{farm.url}/api/jobs/{other}").raise_for_status()
    # The browser reports the refused film of the failed frame; the page shows the reason.
    assert [error for error in watched.errors if "409" not in error] == []


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.long)])
def test_phone_layout_has_controls_below_picture(farm: Farm, browser: Browser, scheme: Any) -> None:
    job = asked(farm, upload_scene(farm, ("shot.glb", animated_scene().glb())), frames="0-7", fps=16, spp=4)
    wait_until(finished(farm, job), 120, "the shot is finished")
    context = browser.new_context(viewport={"width": 375, "height": 812}, color_scheme=scheme, has_touch=True)
    try:
        page = context.new_page()
        page.goto(f"{farm.url}/#/jobs/{job}?frame=3")
        expect(strip_cell(page, 3)).to_have_attribute("aria-selected", "true")
        assert page.evaluate("document.documentElement.scrollWidth") == 375
        stage, bar, strip = (page.locator(name).bounding_box() for name in (".stage-box", ".play-bar", ".filmstrip"))
        assert stage and bar and strip
        assert stage["y"] + stage["height"] <= bar["y"] + 1 and bar["y"] + bar["height"] <= strip["y"] + 1
        strip_cell(page, 4).tap()
        expect(page.locator(".frame-number")).to_have_text("4")
        page.get_by_role("button", name="Play", exact=True).tap()
        expect(page.locator(".loaded")).to_contain_text("8 of 8 in memory")
    finally:
        context.close()


@pytest.mark.long
def test_filmstrip_renders_only_visible_frames(page: Page) -> None:
    body = """
        document.head.innerHTML += '<link rel="stylesheet" href="/css/tokens.css"><link rel="stylesheet" href="/css/shot.css">';
        const { ShotFrames } = await import("/js/shot/shot-frames.js");
        const { Disposer } = await import("/js/base/store.js");
        window.frames_ = new ShotFrames(a, 3);
        const frame = (number) => ({ number, state: "running", samples: 0, spp: 0, progress: 0.5, noise: null, error: null });
        window.frames_.take(Array.from({ length: 2000 }, (_, i) => frame(i)));
        document.body.append(m.filmstrip("job", window.frames_, new Disposer()));"""
    call(page, "shot/filmstrip", body, MANY)
    expect(strip_cell(page, 3)).to_have_attribute("aria-selected", "true")
    assert 5 < page.locator(".frame-cell").count() < 30
    expect(strip_cell(page, 3)).to_have_attribute("aria-setsize", "2000")
    page.evaluate("window.frames_.go(1999)")
    expect(strip_cell(page, 1999)).to_be_in_viewport()
    assert 2 < page.locator(".frame-cell").count() < 30
    active = page.get_by_role("listbox").get_attribute("aria-activedescendant")
    expect(page.locator(f"[id='{active}']")).to_have_accessible_name("Frame 1999 is rendered, 50 %")


@pytest.mark.long
def test_playback_keeps_rate_and_skips_late_frames(page: Page) -> None:
    """Playback keeps to the frame rate, and skips frames that would be drawn too late.

    The page's clock is simulated, since a busy machine would draw late by itself.
    """
    body = """
        const { ShotFrames } = await import("/js/shot/shot-frames.js");
        let now = 1000;
        let due = null;
        performance.now = () => now;
        window.requestAnimationFrame = (draw) => { due = draw; return 1; };
        window.cancelAnimationFrame = () => { due = null; };
        const pass = (ms) => { now += ms; const draw = due; due = null; draw?.(now); };
        const draw = (times) => { for (let i = 0; i < times; i++) pass(1000 / 60); };
        const frames = new ShotFrames(a);
        const memory = { loaded: () => ({ here: 1, of: 1 }), fill() {}, wanted: false };
        const player = new m.Player(frames, memory, () => 100);
        const seen = [];
        frames.current.subscribe((number) => seen.push([now, number]));
        player.play();
        draw(9);
        pass(300);
        draw(9);
        player.pause();
        frames.range.set([10, 19]);
        player.play();
        draw(30);
        player.pause();
        player.loop.set(false);
        const looped = seen.length;
        player.play();
        draw(24);
        return { seen, looped, playing: player.playing.value, last: frames.current.value };"""
    done = call(page, "shot/player", body, MANY)
    first = [(at, number) for at, number in done["seen"][: done["looped"]] if number > 0]
    run = first[: next(i for i in range(1, len(first)) if first[i][1] < first[i - 1][1])]
    (begin, zero), (end, last) = run[0], run[-1]
    assert last - zero == pytest.approx((end - begin) / 10, abs=1), "a hundred frames a second, whatever came between"
    assert max(b[1] - a[1] for a, b in pairwise(run)) >= 30, "those that came too late were left out"
    part = {number for _, number in first[len(run) :]}
    assert part <= set(range(10, 20)) and len(part) > 3
    assert (done["playing"], done["last"]) == (False, 19)


@pytest.mark.long
def test_failed_frame_thumbnail_is_requested_again(page: Page) -> None:
    asked: list[int] = []

    def answer(route: Route) -> None:
        asked.append(503 if not asked else 200)
        picture = (WEB / "icon.svg").read_bytes() if asked[-1] == 200 else b""
        route.fulfill(status=asked[-1], body=picture, content_type="image/svg+xml")

    page.route("**/small", answer)
    body = """
        const image = new Image();
        image.hidden = true;
        new m.Thumbnails().ask(image, "/small");
        while (image.hidden) await new Promise((done) => setTimeout(done, 20));
        return image.complete;"""
    assert call(page, "shot/thumbnails", body)
    assert asked == [503, 200]
