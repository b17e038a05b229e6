"""Tests of the page's JavaScript modules in the browser, against Python, without a farm."""

from __future__ import annotations

import io
import time
from itertools import cycle, product

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page

from renderer.image import rgbe9995, tonemap
from tests.e2e.site import HEIGHT, WIDTH, Site, call, sample_radiance
from tests.grids import grid

EXPOSURES = (-3.0, 0.0, 2.5)
LOOKS = {
    "each curve": list(zip(cycle(EXPOSURES), tonemap.CURVES, strict=False)),
    "each curve at each exposure": list(product(EXPOSURES, tonemap.CURVES)),
}


@grid("looks", LOOKS, ordinary=("each curve",))
def test_shader_tone_mapping_equals_python(looks: str, page: Page) -> None:
    """The page's shader applies all tone curves as Python does, within one 8-bit step, over a range of 21 stops."""
    film = sample_radiance()
    mount = """
        const view = new m.FilmView(a.width, a.height, { cursor() {}, moved() {} });
        document.body.replaceChildren(view.element);
        Object.assign(document.body.style, { margin: 0, height: "100vh", whiteSpace: "normal" });
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


def test_live_picture_acknowledges_and_reconnects(page: Page, site: Site) -> None:
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


@pytest.mark.long
def test_pending_pin_request_is_not_repeated(page: Page) -> None:
    """While tiles arrive, the statistics of a pinned area are updated at once.

    A pending request for a pinned pixel is not cancelled and sent again for each tile.
    """
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
def test_retry_after_is_respected(page: Page) -> None:
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
        const begun = performance.now(), answer = m.fetchWithRetries("/film");
        await new Promise((done) => setTimeout(done, 200));
        const banner = document.querySelector(".lost-banner.busy");
        const words = banner.hidden ? null : banner.textContent.trim();
        const { status } = await answer;
        const ms = performance.now() - begun;
        asked = 0;
        const left = new AbortController();
        const gone = m.fetchWithRetries("/film", { signal: left.signal }).catch((error) => error.name);
        setTimeout(() => left.abort(), 50);
        const name = await gone;
        window.fetch = before;
        return { status, ms, words, said, name, hidden: banner.hidden };""",
    )
    assert found["status"] == 200 and found["ms"] >= 2000
    assert found["words"] in ("Server busy, retrying in 1 s", "Server busy, retrying in 2 s")
    assert found["said"] == [0, 1, 0, 1, 0, 1, 0]
    assert found["name"] == "AbortError" and found["hidden"]
