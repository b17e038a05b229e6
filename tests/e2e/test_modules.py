"""The page's modules by themselves, in the browser, against what Python says; no farm."""

from __future__ import annotations

import io
import time
from itertools import cycle, product

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page

from renderer.image import rgbe9995, tonemap
from tests.e2e.site import HEIGHT, WIDTH, Site, call, packet, radiances
from tests.grids import grid


def test_words_decode_as_python_packs_them(page: Page) -> None:
    words = np.random.default_rng(1).integers(0, 1 << 32, 500, dtype=np.uint32)
    decoded = call(page, "film/rgb9e5", "return a.map((word) => m.decode(word));", words.tolist())
    np.testing.assert_array_equal(decoded, rgbe9995.unpack(words))
    peaks = call(page, "film/rgb9e5", "return a.map((word) => m.peak(word));", words.tolist())
    np.testing.assert_array_equal(peaks, rgbe9995.unpack(words).max(axis=1))


def test_a_damaged_packet_is_refused(page: Page) -> None:
    whole = list(packet(5, radiances(), 3))
    body = "const tile = m.decodeTile(new Uint8Array(a).buffer); return [tile.seq, tile.w, tile.h, tile.spp];"
    assert call(page, "news/tile-packet", body, whole) == [5, WIDTH, HEIGHT, 3]
    refused = "try { m.decodeTile(new Uint8Array(a).buffer); return 'taken'; } catch (error) { return error.message; }"
    assert "came with" in call(page, "news/tile-packet", refused, whole[:-4])
    assert "version 9" in call(page, "news/tile-packet", refused, [9, *whole[1:]])


def test_files_that_are_refused_are_spoken_of_in_the_plural(page: Page) -> None:
    body = "return m.notTaken(a.map((path) => ({ path })));"
    assert call(page, "shell/gather-files", body, ["room.obj"]) == "room.obj was not taken"
    assert call(page, "shell/gather-files", body, ["a.png", "room.obj", "b.png"]) == "room.obj and 2 more were not taken"


def test_zooming_keeps_the_pixel_under_the_cursor(page: Page) -> None:
    body = """
        const view = new m.Viewport();
        view.setPicture(1280, 720);
        view.resizeCanvas(1000, 800);
        const found = [];
        for (const factor of a) {
            const before = (300 - view.x) / view.scale;
            view.zoomTo(view.scale * factor, 300, 400);
            found.push([before, (300 - view.x) / view.scale, view.scale]);
        }
        return found;"""
    for before, after, scale in call(page, "film/viewport", body, [1.7, 3, 2.2, 0.4, 5, 0.1, 1.01]):
        assert abs(before - after) <= 0.5 / scale + 1e-9, "the origin is rounded to a whole pixel of the screen, no more"


EXPOSURES = (-3.0, 0.0, 2.5)
LOOKS = {
    "each curve": list(zip(cycle(EXPOSURES), tonemap.CURVES, strict=False)),
    "each curve at each exposure": list(product(EXPOSURES, tonemap.CURVES)),
}


@grid("looks", LOOKS, ordinary=("each curve",))
def test_the_shader_is_the_tone_mapping_of_python(looks: str, page: Page) -> None:
    """Every curve over 21 stops, on the screen: to a last bit of 8."""
    film = radiances()
    mount = """
        const view = new m.FilmView(a.width, a.height, { cursor() {}, moved() {} });
        document.body.replaceChildren(view.element);
        Object.assign(document.body.style, { margin: 0, whiteSpace: "normal" });
        Object.assign(view.element.style, { position: "fixed", inset: 0 });
        for (const canvas of view.element.children) canvas.style.position = "absolute";
        const { Film } = await import("/js/film/film.js");
        view.layers[0].setFilm(new Film(a.width, a.height, new Uint32Array(a.words)));
        view.canvas.resize();
        view.actualSize();
        window.view = view;"""
    call(page, "film/film-view", mount, {"width": WIDTH, "height": HEIGHT, "words": rgbe9995.pack(film).ravel().tolist()})
    for exposure, curve in LOOKS[looks]:
        origin = page.evaluate(
            """async (look) => {
                view.setLook(look);
                await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
                return [view.viewport.x, view.viewport.y];
            }""",
            {"exposure": exposure, "curve": curve},
        )
        page.wait_for_timeout(100)
        clip = {"x": origin[0], "y": origin[1], "width": WIDTH, "height": HEIGHT}
        screen = np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB")).astype(int)
        wanted = tonemap.apply(rgbe9995.unpack(rgbe9995.pack(film)), exposure, curve)
        assert np.abs(screen - wanted).max() <= 1, (exposure, curve)


def test_a_live_picture_acknowledges_and_comes_back_when_it_is_cut_off(page: Page, site: Site) -> None:
    body = """
        const news = [];
        await new Promise((done) => {
            setTimeout(done, 15000);
            new m.Live("abc", 0, {
                tile(tile) { news.push(["tile", tile.spp]); if (tile.spp === 20) done(); },
                message(message) { news.push(["state", message.job.id]); },
                link(up) { news.push(["link", up]); },
                refused(sentence) { news.push(["refused", sentence]); },
            });
        });
        return news;"""
    news = call(page, "news/live", body)
    once = [["link", True], ["state", "abc"]]
    assert news == [*once, ["tile", 10], ["link", False], *once, ["tile", 20]]
    deadline = time.monotonic() + 5
    while len(site.acks) < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert site.acks == [1, 2]


def test_an_area_is_measured_as_numpy_does(page: Page) -> None:
    film = rgbe9995.unpack(rgbe9995.pack(radiances()))
    words = rgbe9995.pack(radiances()).ravel().tolist()
    body = """
        const { Film } = await import("/js/film/film.js");
        const film = new Film(a.width, a.height, new Uint32Array(a.words));
        film.samples.fill(1);
        film.samples[10 * a.width + 12] = 0;
        return a.rects.map((rect) => m.areaOf(film, rect));"""
    rects = [{"x": 4, "y": 5, "w": 1, "h": 1}, {"x": 8, "y": 6, "w": 20, "h": 9}, {"x": 60, "y": 40, "w": 99, "h": 99}]
    there = np.ones((HEIGHT, WIDTH), bool)
    there[10, 12] = False
    asked = {"width": WIDTH, "height": HEIGHT, "words": words, "rects": rects}
    for rect, area in zip(rects, call(page, "film/area", body, asked), strict=True):
        part = np.s_[rect["y"] : rect["y"] + rect["h"], rect["x"] : rect["x"] + rect["w"]]
        light = film[part][there[part]].astype(float)
        luminance = light @ [0.2126, 0.7152, 0.0722]
        wanted = [*light.mean(0), luminance.mean(), luminance.min(), luminance.max(), luminance.std()]
        assert area["pixels"] == len(light)
        np.testing.assert_allclose(
            [*area["rgb"], *(area[name] for name in ("luminance", "least", "most", "spread"))], wanted, rtol=1e-9
        )
    nothing = {"width": WIDTH, "height": HEIGHT, "words": words, "rects": [{"x": 12, "y": 10, "w": 1, "h": 1}]}
    assert call(page, "film/area", body, nothing)[0]["pixels"] == 0


def test_pins_go_through_the_url(page: Page) -> None:
    body = "return a.map((text) => m.pinsText(m.pinsFrom(text)));"
    kept = ["3,4", "3,4;10,12,20,5", "0,0,1,1"]
    assert call(page, "job/pins", body, kept) == kept
    assert call(page, "job/pins", body, ["3", "3,x", "-1,4", "1,2,3", "1,2,0,5", "1,2,3,-4", "", "1,2;what;5,6"]) == [
        None
    ] * 7 + ["1,2;5,6"]


@pytest.mark.long
def test_a_slow_answer_about_a_pin_is_waited_for(page: Page) -> None:
    """Tiles come meanwhile: areas are measured at once, and the question is not begun anew with each of them."""
    body = """
        const { Store, Disposer } = await import("/js/base/store.js");
        const { Film } = await import("/js/film/film.js");
        const film = new Film(8, 8);
        let tile = () => {};
        const quiet = () => () => {};
        const onTile = (listener) => ((tile = listener), () => {});
        const live = { job: "j", frame: 0, film, onTile, onFill: quiet, onTurn: quiet };
        const asked = [];
        window.fetch = (url, { signal }) => new Promise((done) => asked.push({ signal, done }));
        const pins = m.pinsFrom("1,1;2,2,4,4");
        const { element } = m.pinsPanel({ view: null, live }, new Store({ pins }), new Disposer(), () => {}, () => {});
        document.body.replaceChildren(element);
        const shown = () => [...element.querySelectorAll("dd")].map((cell) => cell.textContent);
        film.put({ x: 0, y: 0, w: 8, h: 8, spp: 1, words: new Uint32Array(64).fill(a) });
        tile();
        await new Promise((done) => setTimeout(done, 1300));
        const before = [asked.length, asked[0].signal.aborted];
        asked[0].done(new Response(JSON.stringify({ color: [1, 2, 3], samples: 4 })));
        await new Promise((done) => setTimeout(done, 1300));
        return [before, asked.length, shown().map(Number)];"""
    word = int(rgbe9995.pack(np.full((1, 1, 3), 0.5, np.float32))[0, 0])
    before, asked, shown = call(page, "job/pins", body, word)
    assert before == [1, False]
    assert asked == 2, "the tile that came meanwhile"
    np.testing.assert_allclose(shown, [1, 2, 3, 1.8596, 0.5, 0.5, 0.5, 0.5], rtol=1e-3)


@pytest.mark.long
def test_how_long_an_upload_still_takes(page: Page) -> None:
    """From the last seconds alone: it was fast at first."""
    body = """
        const pace = new m.Pace(1_000_000);
        return a.map(([sent, at]) => { pace.put(sent, at); return pace.now; });"""
    fast = [[0, 0], [100_000, 500], [400_000, 2000]]
    slow = [[400_000 + 10_000 * s, 2000 + 1000 * s] for s in range(1, 11)]
    found = call(page, "shell/upload-pace", body, fast + slow)
    assert found[:2] == [None, None]
    assert found[2] == {"speed": 200_000, "left": 3}
    assert found[-1]["speed"] == pytest.approx(10_000) and found[-1]["left"] == pytest.approx(50)
    assert call(page, "shell/upload-pace", body, [[0, 0], [5, 100], [5, 9000]])[-1] is None, "it stands still"


def test_keys_of_one_letter_can_be_turned_off(page: Page) -> None:
    body = """
        const done = [];
        const shortcut = (keys) => ({ keys, does: keys, run: () => done.push(keys) });
        const off = m.addShortcuts(["E", "?", "ArrowUp", "Escape"].map(shortcut));
        for (const act of [true, false, true]) {
            m.letLettersAct(act);
            for (const key of ["e", "?", "ArrowUp", "Escape"]) dispatchEvent(new KeyboardEvent("keydown", { key }));
            done.push(m.lettersAct());
        }
        off();
        return done;"""
    all_of_them = ["E", "?", "ArrowUp", "Escape", True]
    assert call(page, "shell/shortcuts", body) == [*all_of_them, "ArrowUp", "Escape", False, *all_of_them]


@pytest.mark.long
def test_a_time_is_as_short_as_it_can_be(page: Page) -> None:
    times = call(page, "base/format", "return a.map(m.clock);", [7, 125, 3725, 47 * 3600, 622 * 3600 + 1098])
    assert times == ["0:07", "2:05", "1:02:05", "47:00:00", "25 d 22 h"]


@pytest.mark.long
def test_the_size_of_a_scene_is_short_whatever_its_unit(page: Page) -> None:
    extents = call(page, "base/format", "return a.map(m.extent);", [[4, 3, 2.54321], [4e5, 3e5, 12], [0, 0, 0], [2e-5, 0, 1e-7]])
    assert extents == ["4 × 3 × 2.54", "4 × 3 × 0.00012 · 10⁵", "0 × 0 × 0", "2 × 0 × 0.01 · 10⁻⁵"]


def test_a_busy_service_is_asked_again_after_the_time_that_it_names(page: Page) -> None:
    found = call(
        page,
        "news/busy",
        """
        const { buildBusyBanner } = await import("/js/shell/shell.js");
        buildBusyBanner();
        const statuses = [503, 503, 200], before = fetch, said = [];
        m.retries.subscribe(({ length }) => said.push(length));
        let asked = 0;
        window.fetch = async () => {
            const status = statuses[asked++];
            return new Response("", { status, headers: status === 503 ? { "Retry-After": "1" } : {} });
        };
        const begun = performance.now(), answer = m.fetchPatiently("/film", new AbortController().signal);
        await new Promise((done) => setTimeout(done, 200));
        const banner = document.querySelector(".lost-banner.busy");
        const words = banner.hidden ? null : banner.textContent.trim();
        const { status } = await answer;
        const ms = performance.now() - begun;
        asked = 0;
        const left = new AbortController();
        const gone = m.fetchPatiently("/film", left.signal).catch((error) => error.name);
        setTimeout(() => left.abort(), 50);
        const name = await gone;
        window.fetch = before;
        return { status, ms, words, said, name, hidden: banner.hidden };""",
    )
    assert found["status"] == 200 and found["ms"] >= 2000
    assert found["words"] in ("Server busy, retrying in 1 s", "Server busy, retrying in 2 s")
    assert found["said"] == [0, 1, 0, 1, 0, 1, 0]
    assert found["name"] == "AbortError" and found["hidden"]
