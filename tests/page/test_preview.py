"""Tests of the page's preview mesh: decoding its packet, projecting it, and showing the steps of preparing a scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from protocol.mesh import decode_mesh, encode_mesh
from renderer.preview_mesh import PreviewLamp, PreviewMaterial, PreviewMesh, PreviewPart, PreviewTexture
from renderer.scene.studio import studio_image
from tests.page.node import Node

VIEW: dict[str, Any] = {"eye": [3, 2, 5], "target": [0.5, 1, -1], "up": [0, 1, 0], "fov": 40}
LOW, HIGH = [-1.0, 0.0, -2.0], [2.0, 3.0, 1.0]


def triangle(**more: Any) -> PreviewMesh:
    positions = np.array([[-1.0, 0, -2], [2, 3, 1], [0.5, 1.5, -0.5]])
    return PreviewMesh(positions, np.eye(3, dtype=np.float32), np.uint8([[1, 2, 3, 255]] * 3), np.uint32([[0, 1, 2]]), **more)


DECODE = """
    const images = [];
    const e = await read("/js/scene/mesh-environment.js");
    const found = m.decodeMesh(new Uint8Array(a).buffer, async (...range) => void images.push(range));
    const plain = Object.entries(found).map(([name, value]) => [name, ArrayBuffer.isView(value) ? [...value] : value]);
    const environment = found.environment && [...e.unpacked(found.environment).texels];
    return { ...Object.fromEntries(plain), environment, images };"""


def test_mesh_packet_is_decoded_as_python_encodes_it(node: Node) -> None:
    uvs = np.float32([[0.25, 0.5], [-1, 2], [0, 1]])
    packet = encode_mesh(
        triangle(
            uvs=uvs,
            parts=(PreviewPart(0, 3, 0),),
            materials=(PreviewMaterial(roughness=0.25, f0=(0.04, 0.05, 0.0625), alpha_mode="blend", texture=1),),
            textures=(PreviewTexture(b"first", "image/jpeg"), PreviewTexture(b"second", "image/webp", "clamp", "mirror", True)),
            lamps=(PreviewLamp((1.0, 2.0, 3.0), True, (0.5, 0.25, 0.125)),),
            environment=np.float32([[[1, 2, 0.5], [4, 0, 0]]]),
        )
    )
    found, known = node.call("news/mesh-packet", DECODE, list(packet)), decode_mesh(packet)
    assert (found["low"], found["high"], found["indices"]) == (LOW, HIGH, [0, 1, 2])
    assert found["positions"] == [0, 0, 0, 0, 65535, 65535, 65535, 0, 32768, 32768, 32768, 0]
    assert found["normals"] == [127, 0, 0, 0, 0, 127, 0, 0, 0, 0, 127, 0]
    assert found["colors"] == [1, 2, 3, 255] * 3
    assert found["uvs"] == uvs.ravel().tolist()
    assert found["parts"] == [part._asdict() for part in known.parts]
    assert found["materials"] == [{**known.materials[0]._asdict(), "emission": [0, 0, 0], "f0": [0.04, 0.05, 0.0625]}]
    assert found["lamps"][0]["color"] == [0.5, 0.25, 0.125] and found["lamps"][0]["far"]
    assert found["environment"] == [1, 2, 0.5, 4, 0, 0]
    assert not found["isStudio"]
    assert [bytes(packet[start:end]) for start, end, _ in found["images"]] == [b"first", b"second"]
    assert found["textures"][1]["sampler"] == {"wrap_s": "clamp", "wrap_t": "mirror", "nearest": True}
    refused = "try { m.decodeMesh(new Uint8Array(a).buffer); return 'taken'; } catch (error) { return error.message; }"
    assert "came with" in node.call("news/mesh-packet", refused, list(encode_mesh(triangle()))[:-4])


def test_mesh_is_shown_before_its_textures_arrive(node: Node) -> None:
    body = """
        const { createImageBitmap } = globalThis;
        globalThis.createImageBitmap = async (blob) => ({ size: blob.size, type: blob.type });
        let send;
        const body = new ReadableStream({ start: (controller) => void (send = controller) });
        const bytes = new Uint8Array(a.packet);
        const found = m.readMesh(body);
        for (let at = 0; at < a.cut; at += 100) send.enqueue(bytes.subarray(at, Math.min(at + 100, a.cut)));
        const { triangles, textures } = await found;
        send.enqueue(bytes.subarray(a.cut, a.cut + 3));
        const first = await textures[0].image;
        send.close();
        const second = await textures[1].image;
        globalThis.createImageBitmap = createImageBitmap;
        return [triangles, first, second];"""
    packet = encode_mesh(triangle(textures=(PreviewTexture(b"abc", "image/webp"), PreviewTexture(b"cut off", "image/jpeg"))))
    cut = len(packet) - len(b"abc" + b"cut off")
    shown = node.call("news/mesh-packet", body, {"packet": list(packet), "cut": cut})
    assert shown == [1, {"size": 3, "type": "image/webp"}, None]


def test_page_has_the_studio_of_the_renderer(node: Node) -> None:
    found = node.call("scene/mesh-environment", "return [...m.studio().texels];")
    np.testing.assert_allclose(np.reshape(found, (64, 128, 3)), studio_image(), rtol=1e-5)


def test_rough_surfaces_reflect_the_same_power(node: Node) -> None:
    """Tables of even light are even; those of a lamp in a black world lose brightness with roughness, and keep its direction."""
    body = """
        const texels = new Float32Array(64 * 128 * 3).fill(a.around);
        texels.fill(a.lamp, 3 * (128 * 20 + 100), 3 * (128 * 20 + 102));
        const surroundings = { up: [0, 1, 0], hasFloor: false, around: [0, 0, 0], isAlone: false };
        const { levels, irradiance } = m.lightTables({ width: 128, height: 64, texels }, surroundings);
        return [levels.map(({ width, texels }) => {
          const red = [...texels].filter((_, i) => i % 4 === 0);
          const most = Math.max(...red);
          const at = red.indexOf(most);
          return [most, Math.min(...red), (at % width) / width, Math.floor(at / width) / (width / 2)];
        }), [...irradiance]];"""
    even, irradiance = node.call("scene/mesh-environment", body, {"around": 0.5, "lamp": 0.5})
    np.testing.assert_allclose([row[:2] for row in even], 0.5, rtol=1e-4)
    np.testing.assert_allclose(irradiance[0] * 0.282095, 0.5, rtol=5e-3)
    lit, _ = node.call("scene/mesh-environment", body, {"around": 0, "lamp": 100})
    brightest = [row[0] for row in lit]
    assert brightest == sorted(brightest, reverse=True) and brightest[-1] < 0.1 * brightest[0]
    np.testing.assert_allclose([row[2:] for row in lit[:4]], [[100 / 128, 20 / 64]] * 4, atol=0.07)


def test_light_of_black_worlds_comes_from_below(node: Node) -> None:
    body = """
        const { irradiance } = m.lightTables(null, { up: [0, 0, 1], hasFloor: false, around: [0.2, 0.2, 0.2], isAlone: true });
        return [[0, 0, -1], [1, 0, 0], [0, 0, 1]].map((normal) => m.irradianceAt(irradiance, normal)[0]);"""
    below, beside, above = node.call("scene/mesh-environment", body)
    assert beside == pytest.approx(0.2, rel=1e-2)
    assert below + above == pytest.approx(0.4, rel=1e-2) and above < 0.5 * beside


def test_floor_of_the_studio_is_as_bright_as_its_horizon(node: Node) -> None:
    body = """
        const surroundings = { up: [0, 1, 0], hasFloor: true, around: [0, 0, 0], isAlone: false };
        const { floor, irradiance } = m.lightTables(m.studio(), surroundings);
        return [floor, m.irradianceAt(irradiance, [0, 1, 0])[0]];"""
    floor, received = node.call("scene/mesh-environment", body)
    assert floor["radiance"] == pytest.approx([0.5] * 3, rel=1e-3)
    assert floor["albedo"] * received == pytest.approx(0.5, rel=0.05)
    assert floor["beyond"] == pytest.approx([1] * 3, abs=0.02), "the studio has no edge at the horizon"


SAMPLES = """
    const found = m.lightSamples({ width: 128, height: 64, texels: Float32Array.from(a.texels) }, a.count);
    return found.map(({ way, color, weight }) => [...way, ...color, weight]);"""


def rgba(radiance: np.ndarray) -> list[float]:
    return np.concatenate([radiance, np.ones((64, 128, 1), np.float32)], axis=2).ravel().tolist()


def test_light_samples_add_up_to_the_irradiance(node: Node) -> None:
    """The samples light surfaces of any normal as the integral over the studio does; half of them give half as much."""
    theta, phi = np.meshgrid((np.arange(64) + 0.5) * np.pi / 64, (np.arange(128) + 0.5) * np.pi / 64 - np.pi, indexing="ij")
    ways = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1)
    samples = np.array(node.call("scene/mesh-light-samples", SAMPLES, {"texels": rgba(studio_image()), "count": 64}))
    for normal in ([0, 1, 0], [0, 0, 1], [-0.6, 0.8, 0], [0.8, 0, -0.6]):
        weights = np.sin(theta) * np.maximum(ways @ normal, 0) * (np.pi / 64) ** 2 / np.pi
        lit = np.maximum(samples[:, :3] @ normal, 0) * samples[:, 3]
        exact = (weights * studio_image()[..., 0]).sum()
        assert lit.sum() == pytest.approx(exact, rel=0.05)
        assert 2 * lit[:32].sum() == pytest.approx(exact, rel=0.12)
    np.testing.assert_allclose(np.linalg.norm(samples[:, :3], axis=1), 1, rtol=1e-6)


def test_light_samples_find_a_small_light_and_no_darkness(node: Node) -> None:
    dark = np.zeros((64, 128, 3), np.float32)
    assert node.call("scene/mesh-light-samples", SAMPLES, {"texels": rgba(dark), "count": 16}) == []
    dark[10, 32] = 40, 20, 10
    samples = np.array(node.call("scene/mesh-light-samples", SAMPLES, {"texels": rgba(dark), "count": 16}))
    theta, phi = 10.5 * np.pi / 64, 32.5 * np.pi / 64 - np.pi
    towards = [np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)]
    assert (samples[:, :3] @ towards).min() > np.cos(0.05)
    np.testing.assert_allclose(samples[:, 3] / samples[:, 4], 2)


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


def test_turned_camera_goes_back_from_denoising_to_rendering(node: Node) -> None:
    body = """
        const times = new m.StepTimes(null);
        for (const [step, now] of a) times.put(step, now);
        times.renderAgain(7);
        const again = [times.step, { ...times.took }, times.since];
        times.put("denoise", 9);
        return [again, times.took];"""
    again, took = node.call("scene/prepare-steps", body, [["render", 1], ["denoise", 5]])
    assert again == ["render", {}, 3]
    assert took == {"render": 6}


def test_preview_says_how_far_its_picture_is(node: Node) -> None:
    pictures = [[0, True], [0.755, True], [1, True], [1.5, False]]
    words = node.call("scene/clarity", "return a.map((each) => m.previewWords(false, false, ...each));", pictures)
    assert words == [
        "Preview, rendering …",
        "Preview, rendering 75 %",
        "Preview, denoising …",
        "Preview, rendering 100 %",
    ]


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


def test_light_is_prepared_before_a_kept_picture_is_measured(node: Node) -> None:
    """Preparing the light binds framebuffers, so it must not begin while the mesh is drawn into that of the kept picture."""
    body = """
        globalThis.devicePixelRatio = 1;
        const calls = [];
        const note = (name) => ({ value: () => void calls.push(name) });
        const gl = new Proxy({}, { get: (_, name) => (name === "isContextLost" ? () => false : () => {}) });
        const kept = { distance: () => a.distance, measure: () => calls.push("measure"), drawBehind() {}, view: a.view };
        const canvas = Object.create(m.MeshCanvas.prototype, {
            gl: { value: gl },
            kept: { value: kept },
            canvas: { value: { clientWidth: 4, clientHeight: 3, dataset: {} } },
            mesh: { value: { low: [0, 0, 0], high: [1, 1, 1], triangles: 1 } },
            view: { value: a.view },
            prepareLight: note("light"),
            drawMesh: note("mesh"),
        });
        canvas.draw();
        return calls;"""
    assert node.call("scene/mesh-canvas", body, {"view": VIEW, "distance": 0.1}) == ["light", "measure", "mesh"]
    assert node.call("scene/mesh-canvas", body, {"view": VIEW, "distance": 0}) == [], "the picture's own camera needs no mesh"


def test_scene_is_seen_from_the_largest_mirrors(node: Node) -> None:
    """Small mirrors share a cube, drawn from the middle, and so do all of a mesh of many triangles, unless there is only one."""
    body = """
        const mirrors = a.sizes.map((size) => ({ middle: [size, 0, 0], size }));
        return m.viewpoints(mirrors, a.triangles).map(({ from, of }) => [from[0], of.map(({ size }) => size)]);"""

    def seen(sizes: list[int], triangles: int = 1000) -> object:
        return node.call("scene/mesh-mirror", body, {"sizes": sizes, "triangles": triangles})

    assert seen([]) == []
    assert seen([1, 3]) == [[3, [3]], [1, [1]]]
    assert seen([1, 6, 3, 5, 4, 2]) == [[6, [6]], [5, [5]], [4, [4]], [0, [3, 2, 1]]]
    assert seen([2], 10**6) == [[2, [2]]]
    assert seen([1, 2], 10**6) == [[0, [2, 1]]]


def test_mirror_is_not_drawn_into_what_it_shows(node: Node) -> None:
    """The cube of other mirrors leaves out balls and emissive surfaces; balls are drawn twice, since mirrors show each other."""
    body = """
        const mirrors = new m.MeshMirrors(new Proxy({}, { get: () => () => ({}) }));
        const surfaces = a.radii.map((radius, first) => ({
            ...{ part: { first }, middle: [first, 0, 0], size: 9, radius, isOutside: false, showsScene: first < 2 },
            material: { alpha_mode: "opaque" },
        }));
        const seen = [];
        const lamps = new Set(surfaces.filter((_, i) => a.lamps.includes(i)).map(({ part }) => part));
        mirrors.draw(surfaces, { radius: 20, triangles: 3, lamps, look: [] }, () => {
            const { from, isChosen, isSeen, isReflecting } = mirrors.drawing;
            seen.push([from[0], surfaces.filter(isChosen).filter(isSeen).map(({ part }) => part.first), isReflecting]);
        });
        return [...seen.filter((_, i) => i % 6 === 0), mirrors.drawing];"""

    def drawn(radii: list[float], lamps: list[int]) -> object:
        return node.call("scene/mesh-mirror", body, {"radii": radii, "lamps": lamps})

    assert drawn([0, 0, 0], []) == [[0, [1, 2], False], [1, [0, 2], False], None]
    balls = [[0, [1], True], [1, [0], True]]
    assert drawn([1, 1, 0, 0], [3]) == [[0, [2], False], [1, [2], False], *balls, *balls, None]


SHAPES = """
    const mesh = (await read("/js/news/mesh-packet.js")).decodeMesh(new Uint8Array(a).buffer, async () => null);
    return [m.placeOf(mesh, mesh.parts[0]), m.rectangleOf(mesh, mesh.parts[0])];"""


def shape(node: Node, positions: np.ndarray, triangles: list[list[int]], normals: np.ndarray) -> Any:
    colors = np.full((len(positions), 4), 255, np.uint8)
    parts, count = (PreviewPart(0, 3 * len(triangles), 0),), np.uint32(triangles)
    mesh = PreviewMesh(positions, np.float32(normals), colors, count, parts=parts, materials=(PreviewMaterial(),))
    return node.call("scene/mesh-parts", SHAPES, list(encode_mesh(mesh)))


def test_balls_and_rectangles_are_recognized(node: Node) -> None:
    """An ellipsoid, a hemisphere and a cube are no balls; a triangle, a disc and a bent quad are no rectangles."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, 13), np.linspace(0, 2 * np.pi, 25), indexing="ij")
    ways = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1).reshape(-1, 3)
    corners = [[25 * r + c, 25 * r + c + 1, 25 * r + c + 25 + k] for r in range(12) for c in range(24) for k in (0, 1)]

    def radius(positions: np.ndarray, triangles: list[list[int]], normals: np.ndarray) -> float:
        return float(shape(node, positions, triangles, normals)[0]["radius"])

    assert radius(3 + 2 * ways, corners, ways) == pytest.approx(2, rel=0.01)
    assert radius(ways * [1, 1.1, 1], corners, ways) == 0
    assert radius(ways, corners[: len(corners) // 2], ways) == 0
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    assert radius(cube, [[0, 1, 2]] * 60, cube / 3**0.5) == 0

    def halves(positions: list[list[float]], triangles: list[list[int]]) -> Any:
        found = shape(node, np.array(positions, np.float64), triangles, np.zeros((len(positions), 3)))[1]
        return found and sorted(np.linalg.norm(found["halves"], axis=1))

    tilted = [[0.0, 0, 0], [3, 0, 4], [3, 2, 4], [0, 2, 0]]
    assert halves(tilted, [[0, 1, 2], [0, 2, 3]]) == pytest.approx([1, 2.5], rel=1e-3)
    assert halves(tilted, [[0, 1, 2]]) is None
    assert halves([*tilted[:3], [0, 2, 1]], [[0, 1, 2], [0, 2, 3]]) is None
    disc = [[float(np.cos(k)), float(np.sin(k)), 0] for k in np.linspace(0, 2 * np.pi, 33)]
    assert halves(disc, [[0, k, k + 1] for k in range(1, 32)]) is None


def test_rectangles_stand_for_the_lamps_at_their_middles(node: Node) -> None:
    body = """
        const mesh = (await read("/js/news/mesh-packet.js")).decodeMesh(new Uint8Array(a).buffer, async () => null);
        return m.rectanglesOf(mesh, mesh.lamps).map((each) => each?.radiance ?? null);"""
    corners = np.array([[4.0, 0, 0], [6, 0, 0], [6, 2, 0], [4, 2, 0]])
    lamps = (PreviewLamp((5.0, 1.0, 0.0), False, (1.0, 1.0, 1.0)), PreviewLamp((5.0, 0.0, 0.0), False, (1.0, 1.0, 1.0)))
    mesh = PreviewMesh(
        corners,
        np.zeros((4, 3), np.float32),
        np.full((4, 4), 255, np.uint8),
        np.uint32([[0, 1, 2], [0, 2, 3]]),
        parts=(PreviewPart(0, 6, 0),),
        materials=(PreviewMaterial(emission=(14.0, 12.0, 10.0)),),
        lamps=lamps,
    )
    assert node.call("scene/mesh-lamps", body, list(encode_mesh(mesh))) == [[14, 12, 10], None]


def test_a_weak_lamp_stands_where_a_surface_shines(node: Node) -> None:
    """A lamp beyond the four strongest keeps its position if an emissive surface encloses it; the others become ambient light."""
    body = """
        const mesh = (await read("/js/news/mesh-packet.js")).decodeMesh(new Uint8Array(a).buffer, async () => null);
        const { lamps, around } = m.lampsOf(mesh.lamps, false, mesh);
        return { lamps: lamps.map(({ at, color }) => [...at, color[0]]), around };"""
    corners = np.array([[4.0, 0, 0], [6, 0, 1], [6, 2, 0], [0, 0, 0], [9, 9, 9], [0, 9, 0]])
    strong = tuple(PreviewLamp((0.0, 9.0, float(i)), False, (4.0 + i,) * 3) for i in range(4))
    weak = (
        PreviewLamp((5.0, 1.0, 0.5), False, (0.5, 0.5, 0.5)),
        PreviewLamp((5.0, 4.0, 0.5), False, (1.0, 1.0, 1.0)),
        PreviewLamp((5.0, 1.0, 0.5), True, (2.0, 2.0, 2.0)),
    )
    mesh = PreviewMesh(
        corners,
        np.zeros((6, 3), np.float32),
        np.full((6, 4), 255, np.uint8),
        np.uint32([[0, 1, 2], [3, 4, 5]]),
        parts=(PreviewPart(0, 3, 0), PreviewPart(3, 3, 1)),
        materials=(PreviewMaterial(emission=(1.0, 2.0, 3.0)), PreviewMaterial()),
        lamps=(*weak, *strong),
    )
    found = node.call("scene/mesh-lamps", body, list(encode_mesh(mesh)))
    assert found["lamps"] == [[0, 9, 3, 7], [0, 9, 2, 6], [0, 9, 1, 5], [0, 9, 0, 4], [5, 1, 0.5, 0.5]]
    assert found["around"] == [1.5, 1.5, 1.5]


def test_reading_is_given_up_when_it_takes_long_or_the_service_refuses(node: Node) -> None:
    """The service's mesh does not wait for the page's own, and the worker ends."""
    mesh = triangle()
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


def test_mesh_of_a_scene_that_was_left_does_not_disturb_the_open_one(node: Node) -> None:
    """Its download ends, and its error does not drop the mesh that is loaded meanwhile."""
    body = """
        const known = { fetch };
        const requested = [];
        globalThis.fetch = async (url, { signal }) => {
            requested.push(url);
            if (url.includes("open")) return new Response(new Uint8Array(a));
            return new Promise((_, reject) => signal.addEventListener("abort", () => reject(signal.reason)));
        };
        try {
            const left = m.meshOf("left").then(() => "loaded", ({ name }) => name);
            while (!requested.length) await new Promise((next) => setTimeout(next));
            const open = m.meshOf("open");
            return [await left, m.meshOf("open") === open, (await open).triangles, requested.length];
        } finally {
            Object.assign(globalThis, known);
        }"""
    assert node.call("scene/preview-mesh", body, list(encode_mesh(triangle()))) == ["AbortError", True, 1, 2]
