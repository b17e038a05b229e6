"""Tests of the page's preview mesh: decoding its packet, projecting it, and showing the steps of preparing a scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from protocol.mesh import Mesh, decode_mesh, encode_mesh
from tests.page.node import Node

VIEW: dict[str, Any] = {"eye": [3, 2, 5], "target": [0.5, 1, -1], "up": [0, 1, 0], "fov": 40}
LOW, HIGH = [-1.0, 0.0, -2.0], [2.0, 3.0, 1.0]


def test_mesh_packet_is_decoded_as_python_encodes_it(node: Node) -> None:
    positions = np.array([[-1.0, 0, -2], [2, 3, 1], [0.5, 1.5, -0.5]])
    mesh = Mesh(positions, np.eye(3, dtype=np.float32), np.uint8([[1, 2, 3, 255]] * 3), np.uint32([[0, 1, 2]]), (255, 128, 9))
    body = """
        const { low, high, positions, normals, colors, indices, background } = m.decodeMesh(new Uint8Array(a).buffer);
        return [low, high, [...positions], [...normals], [...colors], [...indices], background];"""
    low, high, shares, normals, colors, indices, background = node.call("news/mesh-packet", body, list(encode_mesh(mesh)))
    assert tuple(background) == decode_mesh(encode_mesh(mesh)).background == (248, 128, 8)
    black, studio = (
        node.call("news/mesh-packet", body, list(encode_mesh(mesh._replace(background=b))))[6] for b in ((0, 0, 0), None)
    )
    assert (black, studio) == ([0, 0, 0], None)
    assert (low, high, indices) == (LOW, HIGH, [0, 1, 2])
    assert shares == [0, 0, 0, 0, 65535, 65535, 65535, 0, 32768, 32768, 32768, 0]
    assert normals == [127, 0, 0, 0, 0, 127, 0, 0, 0, 0, 127, 0]
    assert colors == [1, 2, 3, 255] * 3
    refused = "try { m.decodeMesh(new Uint8Array(a).buffer); return 'taken'; } catch (error) { return error.message; }"
    assert "came with" in node.call("news/mesh-packet", refused, list(encode_mesh(mesh))[:-4])


def projected_point(node: Node, view: dict[str, Any], point: list[float], aspect: float = 1.5) -> np.ndarray:
    """Returns the normalised device coordinates at which the preview shows a point. aspect: width / height of the picture."""
    call = "return [...m.clipMatrix(a.view, a.aspect, a.low, a.high)];"
    columns = node.call("scene/mesh-camera", call, {"view": view, "aspect": aspect, "low": LOW, "high": HIGH})
    clip = np.array(columns).reshape(4, 4).T @ [*(np.array(point) - (np.array(LOW) + HIGH) / 2), 1]
    return np.asarray(clip[:3] / clip[3])


def test_preview_projection_equals_path_tracer(node: Node) -> None:
    """The preview projects points as the path tracer does.

    The view's target is in the picture's centre; a point half the view's height above it, at the same distance, is at the upper
    edge. Lens shifts and orthographic views are tested too.
    """
    np.testing.assert_allclose(projected_point(node, VIEW, VIEW["target"])[:2], 0, atol=1e-6)
    eye, target = np.array(VIEW["eye"], float), np.array(VIEW["target"], float)
    forward = target - eye
    distance = np.linalg.norm(forward)
    right = np.cross(forward, VIEW["up"])
    right /= np.linalg.norm(right)
    above = np.cross(right, forward / distance)
    half = distance * math.tan(math.radians(20))
    np.testing.assert_allclose(projected_point(node, VIEW, list(target + half * above))[:2], [0, 1], atol=1e-5)
    np.testing.assert_allclose(projected_point(node, VIEW, list(target + 1.5 * half * right))[:2], [1, 0], atol=1e-5)
    shifted = {**VIEW, "shift_x": 0.25, "shift_y": -0.1}  # shifts are in picture heights
    np.testing.assert_allclose(projected_point(node, shifted, VIEW["target"])[:2], [-0.5 / 1.5, 0.2], atol=1e-5)
    flat = {**VIEW, "projection": "orthographic", "height": 4.0}
    np.testing.assert_allclose(projected_point(node, flat, list(target + 2 * above))[:2], [0, 1], atol=1e-5)


@pytest.mark.parametrize("more", [{}, {"projection": "orthographic", "height": 4.0}])
def test_scene_is_between_clipping_planes(node: Node, more: dict[str, Any]) -> None:
    corners = [[x, y, z] for x in (LOW[0], HIGH[0]) for y in (LOW[1], HIGH[1]) for z in (LOW[2], HIGH[2])]
    for view in (VIEW, {**VIEW, "eye": [300, 200, 500]}):
        assert all(-1 <= projected_point(node, {**view, **more}, corner)[2] <= 1 for corner in corners)


def test_preparation_steps_are_timed(node: Node) -> None:
    body = """
        const times = new m.StepTimes(0.2);
        for (const [progress, code, now] of a) times.put(m.stepOf({ progress, codes: { step: { code } } }), now);
        return [times.step, times.took];"""
    heard = [
        [0, "waits-for-free-worker", 0],
        [0.05, "", 1],
        [0.3, "", 1.5],
        [0.9, "compiling-renderer", 2],
        [0.2, "", 3],
        [0.95, "", 42],
    ]
    step, took = node.call("scene/prepare-steps", body, heard)
    assert step == "render"
    assert took == {"upload": 0.2, "read": 0.5, "build": 0.5, "compile": 40}


def test_kept_picture_serves_near_cameras(node: Node) -> None:
    """The distance is 0 for the picture's own camera, and 1 after a large turn or with another projection."""
    body = """
        const kept = Object.create(m.KeptPicture.prototype, { view: { value: a.from } });
        return a.to.map((view) => kept.distance(view));"""
    turned = [{**VIEW, "eye": [3 + away, 2, 5]} for away in (0, 0.3, 3, 30)]
    same, near, far, farthest = node.call("scene/kept-picture", body, {"from": VIEW, "to": turned})
    assert (same, farthest) == (0, 1)
    assert 0 < near < far < 1
    assert node.call("scene/kept-picture", body, {"from": VIEW, "to": [{**VIEW, "projection": "panorama"}]}) == [1]
    flat = {**VIEW, "projection": "orthographic", "height": 4.0}
    same, zoomed, far = node.call(
        "scene/kept-picture", body, {"from": flat, "to": [flat, {**flat, "height": 5.0}, {**flat, "height": 90.0}]}
    )
    assert (same, far) == (0, 1)
    assert 0 < zoomed < 1


def test_reading_is_given_up_when_it_takes_long_or_the_service_refuses(node: Node) -> None:
    """The service's mesh does not wait for the page's own, and the worker ends."""
    mesh = Mesh(np.eye(3), np.eye(3, dtype=np.float32), np.uint8([[1, 2, 3, 255]] * 3), np.uint32([[0, 1, 2]]), None)
    body = """
        const known = { fetch, setTimeout, Worker: globalThis.Worker };
        const ended = [];
        let begun = () => {};
        globalThis.Worker = class { postMessage() { begun(); } terminate() { ended.push(this); } }; // it never answers
        globalThis.setTimeout = (run, ms, ...rest) => known.setTimeout(run, ms / 1000, ...rest);
        const info = { formats: [".obj"] };
        globalThis.fetch = async (url) => (url.includes("preview") ? new Response(new Uint8Array(a)) : Response.json(info));
        try {
            const { keepLocal, readLocally } = await read("/js/news/local-mesh.js");
            const files = [{ path: "a.obj", file: { size: 9 } }];
            const own = readLocally(files, new AbortController().signal);
            keepLocal("s", own);
            const { triangles } = await m.meshOf("s");
            const given = [await own, ended.length];
            globalThis.setTimeout = known.setTimeout;
            const refused = new AbortController();
            const isBegun = new Promise((done) => (begun = done));
            const second = readLocally(files, refused.signal);
            await isBegun;
            refused.abort();
            return [triangles, ...given, await second, ended.length];
        } finally {
            Object.assign(globalThis, known);
        }"""
    assert node.call("scene/preview-mesh", body, list(encode_mesh(mesh))) == [1, None, 1, None, 2]
