"""Tests of what replaces what in the live view, and of the light that the page's preview mesh is given."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pytest

from renderer.image import rgbe9995
from tests.page.node import Node

USUAL = {
    "isOutdated": False,
    "isPoor": False,
    "share": 1,
    "isDenoised": True,
    "isLast": False,
    "isLatest": True,
    "denoises": True,
    "waited": 1000,
}
NEVER = None


def first_replacing(node: Node, **facts: Any) -> float | None:
    """Returns the fewest samples per pixel of a picture that replaces what is shown; None: no number does."""
    body = "return a.counts.find((spp) => m.replaces({ ...a.facts, spp })) ?? null;"
    counts = [0, 1, 2, 4, 8, 16, 64, 256]
    found: float | None = node.call("scene/replacement", body, {"facts": {**USUAL, **facts}, "counts": counts})
    return found


@pytest.mark.parametrize(
    ("shown", "denoised", "noise_of_undenoised"),
    [("nothing", 0, 4), ("thumbnail", 0, 4), ("clear", 16, 8), ("mesh", 2, 4), ("projected", 2, 1)],
)
def test_picture_replaces_what_is_shown_once_it_looks_better(
    node: Node, shown: str, denoised: int, noise_of_undenoised: int
) -> None:
    assert first_replacing(node, shown=shown) == denoised
    assert first_replacing(node, shown=shown, isDenoised=False, denoises=False) == noise_of_undenoised
    assert first_replacing(node, shown=shown, isLast=True) == 0, "nothing better comes"


@pytest.mark.parametrize("shown", ["thumbnail", "clear", "mesh", "projected"])
def test_noise_never_replaces_a_picture_of_the_view_while_denoised_ones_come(node: Node, shown: str) -> None:
    for more in ({}, {"waited": 1e9}, {"isLast": True}):
        assert first_replacing(node, shown=shown, isDenoised=False, **more) is NEVER
    assert first_replacing(node, shown=shown, isOutdated=True, isDenoised=False) is NEVER
    assert first_replacing(node, shown=shown, isOutdated=True, isDenoised=False, waited=2001) == 0, "an old light is worse"
    assert first_replacing(node, shown=shown, isOutdated=True) == 0, "a small picture shows the new light"


@pytest.mark.parametrize("shown", ["clear", "mesh", "projected"])
def test_picture_of_an_earlier_request_replaces_nothing(node: Node, shown: str) -> None:
    """It has another camera or light: the mesh already shows the new ones."""
    assert first_replacing(node, shown=shown, isLatest=False, isLast=True, waited=1e9) is NEVER


def test_small_picture_replaces_nothing_sharp(node: Node) -> None:
    for shown in ("clear", "mesh", "projected"):
        assert first_replacing(node, shown=shown, share=0.5, waited=1e9) is NEVER
    assert first_replacing(node, shown="projected", share=0.5, isPoor=True) == 0, "which shows little of the view"


def test_projected_picture_stays_at_rest_only_where_it_is_sharp(node: Node) -> None:
    cases = [[0, 0.5], [0.05, 0.9], [0.05, 0.8], [0.14, 1]]
    assert node.call("scene/replacement", "return a.map((each) => m.staysSharp(...each));", cases) == [True, True, False, False]


def sent(radiance: np.ndarray, lamps: list[dict[str, Any]]) -> dict[str, Any]:
    """Returns a light as the service sends it (PreviewLightOut)."""
    words = base64.b64encode(rgbe9995.pack(radiance.astype(np.float32)).astype("<u4").tobytes()).decode()
    return {"width": radiance.shape[1], "height": radiance.shape[0], "words": words, "lamps": lamps}


def test_sent_light_is_that_of_the_mesh_turned_and_scaled(node: Node) -> None:
    """A mesh keeps its lamps, and has the sun of a sky besides."""
    sky = np.random.default_rng(3).uniform(0.1, 1, (4, 8, 3))
    lamp = {"at": [0, 5, 0], "far": False, "color": [1, 1, 1], "axis": [0, 0, 0], "cosines": [-2, -1]}
    sun = {**lamp, "at": [0, 0.6, -0.8], "far": True, "color": [3, 2, 1]}
    body = """
        const mesh = { environment: null, isStudio: true, lamps: [a.lamp] };
        const chosen = { sky: { elevation: 37 }, rotation: 90, strength: 2 };
        const before = m.isComputable(mesh, chosen);
        m.keepLight(mesh, chosen, a.light);
        const { environment, lamps } = m.chosenLight(mesh, chosen);
        const others = [{ sky: { elevation: 30 } }, { preset: "studio" }].map((other) => m.isComputable(mesh, other));
        return [before, others, [...environment.texels], lamps];"""
    light = {"lamp": lamp, "light": sent(sky, [lamp, sun])}
    before, others, texels, lamps = node.call("scene/chosen-light", body, light)
    assert [before, *others] == [False] * 3
    np.testing.assert_allclose(np.reshape(texels, (4, 8, 3)), 2 * np.roll(sky, -2, axis=1), atol=0.01)
    assert lamps[0] == lamp
    assert lamps[1]["color"] == [6, 4, 2]
    np.testing.assert_allclose(lamps[1]["at"], [-0.8, 0.6, 0], atol=1e-6)


def test_light_is_fetched_for_each_mesh_without_a_sun(node: Node) -> None:
    """The service's mesh replaces the page's own, and often has as many triangles."""
    body = """
        const { isComputable } = await read("/js/scene/chosen-light.js");
        const usual = globalThis.fetch;
        let fetched = 0;
        globalThis.fetch = async () => (fetched++, new Response(JSON.stringify(a.light)));
        try {
            const mesh = () => ({ triangles: 5, environment: null, isStudio: true, lamps: [] });
            const sunny = { ...mesh(), environment: {}, lamps: [{ ...a.lamp, far: true }] };
            const request = { environment: { preset: "studio" } };
            let arrived = () => {};
            const lights = new m.SentLights("s", () => arrived());
            const found = [];
            for (const each of [mesh(), mesh()]) {
                const arriving = new Promise((resolve) => (arrived = resolve));
                for (let i = 0; i < 2; i++) lights.want(each, request);
                await Promise.race([arriving, new Promise((resolve) => setTimeout(resolve, 1000))]);
                found.push(isComputable(each, request.environment));
            }
            lights.want(sunny, request);
            await new Promise((resolve) => setTimeout(resolve));
            return [found, fetched];
        } finally {
            globalThis.fetch = usual;
        }"""
    lamp = {"at": [0, 1, 0], "color": [1, 1, 1], "axis": [0, 0, 0], "cosines": [-2, -1]}
    light = sent(np.ones((2, 4, 3)), [])
    assert node.call("scene/sent-light", body, {"light": light, "lamp": lamp}) == [[True, True], 2]


def test_sun_that_is_dragged_is_fetched_once_at_rest(node: Node) -> None:
    body = """
        const usual = globalThis.fetch;
        const fetched = [];
        globalThis.fetch = async (url) => (fetched.push(url), new Response(JSON.stringify(a)));
        try {
            const mesh = { triangles: 5, environment: null, isStudio: true, lamps: [] };
            const arriving = new Promise((resolve) => {
                const lights = new m.SentLights("s", resolve);
                for (const elevation of [10, 20, 30]) lights.want(mesh, { environment: { sky: { elevation, azimuth: 5 } } });
            });
            await Promise.race([arriving, new Promise((resolve) => setTimeout(resolve, 2000))]);
            return fetched;
        } finally {
            globalThis.fetch = usual;
        }"""
    light = sent(np.ones((2, 4, 3)), [])
    assert node.call("scene/sent-light", body, light) == ["api/scenes/s/preview-light?elevation=30&azimuth=5"]


def test_light_of_the_first_request_lights_the_mesh_as_soon_as_it_arrives(node: Node) -> None:
    """The picture of the same light that is projected stays."""
    body = """
        const { RequestedScene } = await read("/js/scene/requested-scene.js");
        const requested = new RequestedScene();
        requested.take({ environment: { preset: "studio" } });
        let isHere = false;
        const calls = [];
        const mesh = { mesh: {}, kept: {}, canvas: { hidden: false }, relight: () => (calls.push("relight"), isHere) };
        const projection = { isOn: true, fade: () => calls.push("fade") };
        const cover = Object.create(m.Cover.prototype, { isInstead: { value: true } });
        Object.assign(cover, { requested, mesh, projection, isDisposed: false, laid: () => calls.push("laid") });
        cover.isMeshTrue = cover.lightMesh();
        isHere = true;
        cover.relight();
        return [cover.isMeshTrue, calls];"""
    assert node.call("scene/cover", body) == [True, ["relight", "relight", "laid"]]


def test_mesh_that_lacks_the_chosen_light_is_not_drawn_black(node: Node) -> None:
    body = """
        const { keepLight } = await read("/js/scene/chosen-light.js");
        const chosen = { preset: "studio" };
        const [lit, other] = [0, 1].map(() => ({ environment: null, isStudio: true, lamps: [] }));
        keepLight(lit, chosen, a);
        return [lit, other].map((mesh) => {
            const canvas = Object.create(m.MeshCanvas.prototype, { gl: { value: null } });
            Object.assign(canvas, { chosen, kept: null });
            canvas.setMesh(mesh);
            return canvas.chosen;
        });"""
    assert node.call("scene/mesh-canvas", body, sent(np.ones((2, 4, 3)), [])) == [{"preset": "studio"}, {}]


def test_chosen_light_is_turned_and_scaled_and_unknown_if_the_page_cannot_compute_it(node: Node) -> None:
    body = """
        const mesh = { environment: null, isStudio: true, lamps: [] };
        return a.map((chosen) => [...(m.chosenLight(mesh, chosen)?.environment.texels ?? [])]);"""
    studio, turned, red, none = node.call(
        "scene/chosen-light", body, [{}, {"rotation": 90, "strength": 2}, {"color": [1, 0, 0]}, {"sky": {"elevation": 30}}]
    )
    before, after = (np.reshape(each, (64, 128, 3)) for each in (studio, turned))
    np.testing.assert_allclose(after, 2 * np.roll(before, -32, axis=1), rtol=1e-6)
    assert (red, none) == ([1, 0, 0], [])
