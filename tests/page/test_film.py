"""Tests of what the page computes from a film.

These are RGB9E5 decoding, statistics of selected areas, pinned pixels, the histogram, and the lines drawn for light paths.
"""

from __future__ import annotations

import numpy as np
import pytest

from renderer.image import rgbe9995
from tests.e2e.site import HEIGHT, WIDTH, film_message, sample_radiance
from tests.page.node import Node


def test_rgb9e5_words_are_decoded_as_python_encodes_them(node: Node) -> None:
    words = np.random.default_rng(1).integers(0, 1 << 32, 500, dtype=np.uint32)
    decoded = node.call("film/rgb9e5", "return a.map((word) => m.decode(word));", words.tolist())
    np.testing.assert_array_equal(decoded, rgbe9995.unpack(words))


def test_damaged_packet_is_rejected(node: Node) -> None:
    whole = list(film_message(5, sample_radiance(), 3))
    body = "const tile = m.decodeTile(new Uint8Array(a).buffer); return [tile.seq, tile.w, tile.h, tile.spp];"
    assert node.call("news/tile-packet", body, whole) == [5, WIDTH, HEIGHT, 3]
    refused = "try { m.decodeTile(new Uint8Array(a).buffer); return 'taken'; } catch (error) { return error.message; }"
    assert "came with" in node.call("news/tile-packet", refused, whole[:-4])
    assert "version 9" in node.call("news/tile-packet", refused, [9, *whole[1:]])


def test_zoom_keeps_pixel_under_cursor(node: Node) -> None:
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
    for before, after, scale in node.call("film/viewport", body, [1.7, 3, 2.2, 0.4, 5, 0.1, 1.01]):
        assert abs(before - after) <= 0.5 / scale + 1e-9, "the origin is rounded to a whole pixel of the screen, no more"


def test_tags_lie_inside_a_fitted_picture(node: Node) -> None:
    """Once the picture is zoomed, they stay in the corners of the stage, as for pictures side by side."""
    body = """
        const view = new m.Viewport();
        view.setPicture(960, 540);
        const found = [[2200, 1150], [1080, 740]].map(([w, h]) => (view.resizeCanvas(w, h), view.margins()));
        view.actualSize();
        found.push(view.margins());
        view.across = 2;
        view.fit();
        return [...found, view.margins()].map(({ beside, above }) => [beside, above]);"""
    assert node.call("film/viewport", body) == [[78, 0], [0, 66], [0, 0], [0, 0]]


def test_area_statistics_equal_numpy(node: Node) -> None:
    film = rgbe9995.unpack(rgbe9995.pack(sample_radiance()))
    words = rgbe9995.pack(sample_radiance()).ravel().tolist()
    body = """
        const { Film } = await read("/js/film/film.js");
        const film = new Film(a.width, a.height, new Uint32Array(a.words));
        film.samples.fill(1);
        film.samples[10 * a.width + 12] = 0;
        return a.rects.map((rect) => m.areaOf(film, rect));"""
    rects = [{"x": 4, "y": 5, "w": 1, "h": 1}, {"x": 8, "y": 6, "w": 20, "h": 9}, {"x": 60, "y": 40, "w": 99, "h": 99}]
    there = np.ones((HEIGHT, WIDTH), bool)
    there[10, 12] = False
    asked = {"width": WIDTH, "height": HEIGHT, "words": words, "rects": rects}
    for rect, area in zip(rects, node.call("film/area", body, asked), strict=True):
        part = np.s_[rect["y"] : rect["y"] + rect["h"], rect["x"] : rect["x"] + rect["w"]]
        light = film[part][there[part]].astype(float)
        luminance = light @ [0.2126, 0.7152, 0.0722]
        wanted = [*light.mean(0), luminance.mean(), luminance.min(), luminance.max(), luminance.std()]
        assert area["pixels"] == len(light)
        np.testing.assert_allclose(
            [*area["rgb"], *(area[name] for name in ("luminance", "least", "most", "spread"))], wanted, rtol=1e-9
        )
    nothing = {"width": WIDTH, "height": HEIGHT, "words": words, "rects": [{"x": 12, "y": 10, "w": 1, "h": 1}]}
    assert node.call("film/area", body, nothing)[0]["pixels"] == 0


def test_pins_are_restored_from_url(node: Node) -> None:
    body = "return a.map((text) => m.pinsText(m.pinsFrom(text)));"
    kept = ["3,4", "3,4;10,12,20,5", "0,0,1,1"]
    assert node.call("job/pins", body, kept) == kept
    assert node.call("job/pins", body, ["3", "3,x", "-1,4", "1,2,3", "1,2,0,5", "1,2,3,-4", "", "1,2;what;5,6"]) == [None] * 7 + [
        "1,2;5,6"
    ]


def test_tiles_in_progress_are_labelled_with_worker_and_slot(node: Node) -> None:
    workers = [
        {"name": "b", "current": [{"job": "j", "frame": 0, "tile": [0, 0, 8, 8]}, {}]},
        {
            "name": "a",
            "current": [{"job": "other"}, {"job": "j", "tile": [8, 0, 8, 8]}, {"job": "j", "frame": 3, "tile": [0, 8, 8, 8]}],
        },
    ]
    found = node.call("film/tile-outlines", "return m.outlinesOf(a, {job: 'j', frame: 0});", workers)
    assert [(each["label"], each["x"]) for each in found] == [("b · 1", 0), ("a · 2", 8)]
    assert found[0]["colour"] != found[1]["colour"]
    alone = node.call("film/tile-outlines", "return m.outlinesOf(a, {job: 'j', frame: 0});", workers[:1])
    assert [each["label"] for each in alone] == [""], "the only worker is not named"


def test_histogram_counts_film_pixels(node: Node) -> None:
    random = np.random.default_rng(3)
    film = np.exp2(random.uniform(-14, 8, (40, 50, 1)) + random.uniform(-1, 1, (40, 50, 3))).astype(np.float32)
    body = """
        const { Film } = await read("/js/film/film.js");
        const film = new Film(50, 40, new Uint32Array(a.words));
        film.samples.fill(1);
        const { channels, ...rest } = m.histogramOf(film, a.exposure);
        return { ...rest, channels: channels.map((c) => [...c]), lowest: m.LOWEST };"""
    words = rgbe9995.pack(film)
    found = node.call("film/histogram", body, {"words": words.ravel().tolist(), "exposure": 1})
    light = rgbe9995.unpack(words).astype(np.float64) * 2
    values = np.concatenate([light, (light @ [0.2126, 0.7152, 0.0722])[..., None]], axis=2)
    for c, counts in enumerate(found["channels"]):
        bins = np.clip(np.floor((np.log2(values[..., c]) - found["lowest"]) * 4), -1, len(counts) - 1).astype(int)
        wanted = np.bincount(bins[bins >= 0].ravel(), minlength=len(counts)) / bins.size
        np.testing.assert_allclose(counts, wanted, atol=1.01 / bins.size)  # values on a bin's edge may be rounded either way
    assert found["above"] == pytest.approx((light.max(axis=2) > 1).mean()) and found["pixels"] == 2000


def test_lines_are_clipped_at_edge_and_behind_eye(node: Node) -> None:
    """A line from a visible point to a point behind the eye is drawn up to the edge of the picture only."""
    room = {"left": 0, "top": 0, "right": 100, "bottom": 100}

    def line(a: list[float], b: list[float]) -> dict | None:
        found: dict | None = node.call(
            "film/path-lines", "return m.lineBetween(...a)", [a, b, {"x": 0, "y": 0, "scale": 1}, room]
        )
        return found

    assert line([10, 10, 1], [180, 100, 2]) == {"from": {"x": 10, "y": 10}, "to": {"x": 90, "y": 50}, "isCut": False}
    out = line([10, 50, 1], [400, 50, 1])
    assert out and out["to"] == {"x": 100, "y": 50} and out["isCut"]
    behind = line([50, 50, 1], [0, -50, -1])  # passes the eye on the right, though its end point is not visible
    assert behind and behind["isCut"]
    assert behind["to"]["x"] == pytest.approx(100)
    assert behind["to"]["y"] == pytest.approx(50)
    assert line([10, 10, -1], [20, 20, -1]) is None
    assert line([-10, -10, 1], [-20, 50, 1]) is None


def test_frame_memory_stays_within_limit(node: Node) -> None:
    for size, count in (((480, 270), 96), ((1280, 720), 250), ((3840, 2160), 2000), ((97, 31), 100_000)):
        body = "return m.planOf({ width: a.size[0], height: a.size[1] }, a.count, 2 ** 29);"
        plan = node.call("shot/frame-memory", body, {"size": size, "count": count})
        side = max(1, min(size[0] // plan["wanted"], size[1]))
        assert (plan["width"], plan["height"]) == (size[0] // side, size[1] // side), "as the service makes it"
        assert plan["fits"] * 4 * plan["width"] * plan["height"] <= 2**29
        assert plan["width"] >= min(size[0], 80)
        if count <= 250:
            assert plan["fits"] >= count, "all of a usual shot"
        if count == 96:
            assert plan["width"] == size[0], "in full where there is room"
