"""Tests of the live view's arithmetic: navigation, URL, packets, light tools."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from protocol.pictures import EXACT, ViewTile, encode_view
from renderer.image import rgbe9995
from renderer.scene.readers.up_axis import ROTATIONS
from renderer.settings import Tile
from tests.helpers import ROOT
from tests.page.node import Node
from tests.service.viewer import body_of, unpacked

VIEW = {"eye": [3, 2, 5], "target": [0.5, 1, -1], "up": [0, 1, 0], "fov": 40}


def vector(view: dict[str, list[float]], name: str) -> np.ndarray:
    return np.array(view[name])


def test_orbiting_keeps_target_and_distance(node: Node) -> None:
    distance = np.linalg.norm(vector(VIEW, "eye") - vector(VIEW, "target"))
    for dx, dy in ((0.3, 0), (0, 0.4), (-2, -0.5), (0.1, 9)):
        turned = node.call("scene/orbit", f"return m.orbit(a, {dx}, {dy});", VIEW)
        assert turned["target"] == VIEW["target"]
        offset = vector(turned, "eye") - vector(turned, "target")
        assert np.linalg.norm(offset) == pytest.approx(distance)
        assert abs(offset[1]) <= math.sin(math.radians(89.001)) * distance, "never along up"
    back = node.call("scene/orbit", "return m.orbit(m.orbit(a, 0.7, 0.2), -0.7, -0.2);", VIEW)
    np.testing.assert_allclose(back["eye"], VIEW["eye"], atol=1e-12)


@pytest.mark.parametrize("axis", [1, 2])
@pytest.mark.parametrize("move", ["m.orbit(v, 0.01, -0.05)", "m.pan(v, 0.01, -0.05)", "m.fly(v, 0, -0.2, 0)", "m.dolly(v, 1.1)"])
def test_eye_stays_above_floor(node: Node, axis: int, move: str) -> None:
    """Repeated turning, moving, flying and pulling back never takes the eye through the floor."""
    up = [0.0, 0.0, 0.0]
    up[axis] = 1.0
    eye = [3.0, -0.5, -0.5]
    target = [0.0, 0.0, 0.0]
    target[axis] = 0.6  # the eye looks up, so that pulling back lowers it
    floor = f"m.floorBelow(true, {up}, [-1, -1, -1], 4)"
    body = f"const floor = {floor}; let v = a; for (let i = 0; i < 60; i++) v = m.aboveFloor(v, {move}, floor); return v;"
    view = node.call("scene/orbit", body, {**VIEW, "eye": eye, "target": target, "up": up})
    assert vector(view, "eye")[axis] == pytest.approx(-0.96)
    if "orbit" in move:
        assert view["target"] == target
        assert np.linalg.norm(vector(view, "eye") - target) == pytest.approx(np.linalg.norm(np.subtract(eye, target)))
    if "fly" in move:
        assert vector(view, "target")[axis] == pytest.approx(0.14)
    free = node.call("scene/orbit", body.replace("true", "false"), {**VIEW, "eye": eye, "target": target, "up": up})
    assert vector(free, "eye")[axis] < -1, "there is no floor"
    below = [-3.0, -2.0, -2.0]
    low = {**VIEW, "eye": below, "target": target, "up": up}
    lower = node.call("scene/orbit", f"return m.aboveFloor(a, m.fly(a, 0, -0.2, 0), {floor});", low)
    assert vector(lower, "eye")[axis] == pytest.approx(-2.2), "a camera below the floor is free"


@pytest.mark.parametrize("height", [-1.0, -0.98])
def test_eye_comes_near_a_target_at_the_floor(node: Node, height: float) -> None:
    """A view that was pulled in to a point on or just above the floor can still be turned and moved."""
    body = (
        "const floor = m.floorBelow(true, [0, 1, 0], [-1, -1, -1], 4); let v = a;"
        "for (let i = 0; i < 60; i++) v = m.aboveFloor(v, m.dolly(v, 0.85), floor);"
        "return [v, m.aboveFloor(v, m.orbit(v, 0.1, -0.1), floor), m.aboveFloor(v, m.pan(v, 0.1, -0.1), floor)];"
    )
    for view in node.call("scene/orbit", body, {**VIEW, "target": [0.0, height, 0.0]}):
        assert np.isfinite([view["eye"], view["target"]]).all()
        assert vector(view, "eye")[1] >= -0.96 - 1e-12


def test_box_outside_the_pyramid_of_view_is_not_in_view(node: Node) -> None:
    """Boxes beside, above and behind the camera, or before it; a panorama sees all."""
    camera = {"eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40}
    ahead, beside, above, behind = [-1, -1, -1], [9, -1, -1], [-1, 9, -1], [-1, -1, 6]

    def sees(low: list[float], **changes: object) -> object:
        view = {**camera, **changes}
        high = [value + 2 for value in low]
        return node.call(
            "scene/in-view", "return m.mayBeInView(a.view, 1.5, a.low, a.high);", {"view": view, "low": low, "high": high}
        )

    assert sees(ahead) is True
    assert [sees(low) for low in (beside, above, behind)] == [False] * 3
    assert sees([-1, -1, 3]) is True, "the camera is inside"
    assert sees(behind, projection="panorama") is True
    assert sees(ahead, projection="orthographic", height=1.0) is True
    assert sees(beside, projection="orthographic", height=2.0) is False
    assert sees([-1, -1, 0], shift_x=3) is False


@pytest.mark.parametrize(
    ("path", "meant"),
    [
        ("scenes", ""),
        ("Scene", ""),
        ("scene/ab12", "scenes/ab12"),
        ("job", "jobs"),
        ("Jobs/ab12", "jobs/ab12"),
        ("compare", "jobs"),
        ("machines/vm", "workers/vm"),
        ("constructor", None),
        ("nowhere/ab12", None),
    ],
)
def test_address_without_a_view_means_the_page_by_another_name(node: Node, path: str, meant: str | None) -> None:
    views = ("", "jobs", "jobs/ID", "compare/ID", "scenes/ID", "workers", "workers/ID")
    told = node.call(
        "shell/meant-path",
        "return m.meantPath(a.path, ([section = '', id]) => a.views.includes(id ? `${section}/ID` : section));",
        {"path": path.split("/"), "views": views},
    )
    assert told == (None if meant is None else meant.split("/") if meant else [])


def test_share_of_the_picture_is_the_area_of_the_outline(node: Node) -> None:
    def share(low: list[float], high: list[float], **changes: object) -> float:
        view = {"eye": [0, 0, 10], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 90, **changes}
        body = "return m.shareInView(a.view, 2, a.low, a.high);"
        found: float = node.call("scene/in-view", body, {"view": view, "low": low, "high": high})
        return found

    # A square of side 2 at distance 10, where the picture is 40 wide and 20 high.
    assert share([-1, -1, 0], [1, 1, 0]) == pytest.approx(4 / 800)
    assert share([-1, -1, 0], [1, 1, 0], projection="orthographic", height=4) == pytest.approx(4 / 32)
    # The near face of a cube hides the others; from a corner the outline is a hexagon of three faces.
    assert share([-1, -1, -1], [1, 1, 1]) == pytest.approx(4 * (10 / 9) ** 2 / 800)
    corner = {"eye": [10, 10, 10], "up": [0, 1, 0], "projection": "orthographic", "height": 4}
    assert share([-1, -1, -1], [1, 1, 1], **corner) == pytest.approx(4 * 3**0.5 / 32)
    assert share([-100, -100, -1], [100, 100, 1]) == 1
    assert share([-1, -1, 3], [1, 1, 12]) == 1, "the camera is inside"
    assert share([-1, -1, 0], [1, 1, 0], projection="panorama") == 1


@pytest.mark.parametrize(
    ("up", "side", "towards"),
    [
        ([0, 1, 0], "front", [0, 0, 1]),
        ([0, 1, 0], "left", [-1, 0, 0]),
        ([0, 0, 1], "back", [0, 1, 0]),
        ([0, 0, 1], "top", [0, 0, 1]),
    ],
)
def test_side_views_frame_scene(node: Node, up: list[int], side: str, towards: list[int]) -> None:
    """A side's camera stands on that side, and shows all of the scene's bounds, on four fifths of a picture of 3:2."""
    low, high = np.array([1.0, -2.0, 0.5]), np.array([2.0, 1.0, 5.0])
    view = node.call(
        "forms/side-views", "return m.sideView(a.side, a.bounds, a.up);", {"side": side, "bounds": [[*low], [*high]], "up": up}
    )
    eye, forward = vector(view, "eye"), vector(view, "target") - vector(view, "eye")
    forward /= np.linalg.norm(forward)
    assert -forward @ np.array(towards) >= math.cos(math.radians(1.01))
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]) - eye
    half = math.tan(math.radians(view["fov"] / 2))
    across = np.abs(corners @ right) / (corners @ forward) / half / (3 / 2)
    upward = np.abs(corners @ np.cross(right, forward)) / (corners @ forward) / half
    assert max(across.max(), upward.max()) == pytest.approx(0.8, abs=1e-4)


@pytest.mark.parametrize(("room", "left"), [(10_000, 8), (350, 3)])
def test_clear_views_are_kept_newest_first_within_bounds(node: Node, room: int, left: int) -> None:
    """A tab keeps the pictures of the latest views, at most eight, and fewer if its storage is full."""
    body = """
        const store = new Map();
        globalThis.sessionStorage = {
            getItem: (key) => store.get(key) ?? null,
            setItem(key, value) {
                if (value.length > a) throw new Error("full");
                store.set(key, value);
            },
        };
        for (let i = 0; i < 10; i++) m.keepClearView("s", `${i}`, "x".repeat(50) + i);
        m.keepClearView("s", "9", "latest");
        return Array.from({ length: 10 }, (_, i) => m.clearView("s", `${9 - i}`).slice(-6));"""
    found = node.call("scene/clear-views", body, room)
    assert found[0] == "latest" and [bool(each) for each in found] == [i < left for i in range(10)]
    assert node.call("scene/clear-views", "return m.clearView('other', '9');") == ""


def test_orbiting_file_camera_keeps_horizon_level(node: Node) -> None:
    """Orbiting keeps the horizon level even if the file's camera has a tilted up vector.

    Files store the camera's own Y axis as the up vector. Only a camera with a roll keeps this vector.
    """
    forward = vector(VIEW, "target") - vector(VIEW, "eye")
    right = np.cross(forward, [0, 1, 0])
    above = np.cross(right, forward)
    pitched = {**VIEW, "up": list(above / np.linalg.norm(above))}
    turned = node.call("scene/orbit", "return m.orbit(a, 1.5, 0.2);", pitched)
    sight = vector(turned, "target") - vector(turned, "eye")
    assert np.cross(sight, vector(turned, "up"))[1] == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(turned["eye"], node.call("scene/orbit", "return m.orbit(a, 1.5, 0.2);", VIEW)["eye"], atol=1e-9)
    rolled = {**VIEW, "up": list(above / np.linalg.norm(above) + 0.3 * right / np.linalg.norm(right))}
    assert node.call("scene/orbit", "return m.orbit(a, 1.5, 0.2);", rolled)["up"] == rolled["up"]


def test_dragged_point_follows_pointer(node: Node) -> None:
    """A dragged point follows the pointer.

    After panning by half a picture height to the right and a quarter down, the view's target is displaced by these distances.
    """
    moved = node.call("scene/orbit", "return m.pan(a, 0.5, 0.25);", VIEW)
    forward = vector(moved, "target") - vector(moved, "eye")
    distance = np.linalg.norm(forward)
    right = np.cross(forward, VIEW["up"])
    right /= np.linalg.norm(right)
    above = np.cross(right, forward / distance)
    seen = vector(VIEW, "target") - vector(moved, "target")
    height = 2 * distance * math.tan(math.radians(VIEW["fov"] / 2))  # type: ignore[operator]
    np.testing.assert_allclose([seen @ right / height, seen @ above / height, seen @ forward], [0.5, -0.25, 0], atol=1e-9)


def test_pixel_depth_is_along_view_direction(node: Node) -> None:
    body = "return m.alongSight(a, { width: 300, height: 200 }, { x: 299, y: 0 }, 7);"
    half = math.tan(math.radians(20))
    direction = np.array([299 / 200 * half, 199 / 200 * half, 1])
    assert node.call("scene/orbit", body, VIEW) == pytest.approx(7 / np.linalg.norm(direction))
    direction += np.array([2 * 0.5, 2 * 0.25, 0]) * half  # of a lens shifted to the right and up
    shifted = {**VIEW, "shift_x": 0.5, "shift_y": 0.25}
    assert node.call("scene/orbit", body, shifted) == pytest.approx(7 / np.linalg.norm(direction))


def test_flying_moves_along_camera_axes(node: Node) -> None:
    moved = node.call("scene/orbit", "return m.fly(a, 0, 2, 3);", VIEW)
    forward = vector(VIEW, "target") - vector(VIEW, "eye")
    way = np.array([0, 2, 0]) + 3 * forward / np.linalg.norm(forward)
    np.testing.assert_allclose(vector(moved, "eye") - vector(VIEW, "eye"), way, atol=1e-12)
    np.testing.assert_allclose(vector(moved, "target") - vector(VIEW, "target"), way, atol=1e-12)


def test_view_is_restored_from_url(node: Node) -> None:
    whole = {**VIEW, "projection": "perspective"}
    other = {**whole, "up": [0, 0, 1], "aperture": 0.02, "focus": 5.3, "projection": "orthographic", "height": 2.5, "near": 0.1}
    shifted = {**whole, "shift_x": 0.25, "shift_y": -0.5}
    body = "return a.map((view) => m.viewFromText(new URLSearchParams({ v: m.viewToText(view) }).get('v')));"
    assert node.call("scene/view-url", body, [whole, other, shifted]) == [whole, other, shifted]
    bad = [None, "", "1_2_3", "1_2_3*1_2_3*40", "1_2_x*0_0_0*40", "1_2_3*0_0_0*400", "1__3*0_0_0*40", "<script>"]
    assert node.call("scene/view-url", "return a.map(m.viewFromText);", bad) == [None] * len(bad)


def test_small_picture_is_upscaled_smoothly(node: Node) -> None:
    small = np.random.default_rng(3).uniform(0.1, 4.0, (3, 4, 3)).astype(np.float32)
    body = """
        const { Film } = await read("/js/film/film.js");
        return [...m.enlarged(new Film(4, 3, new Uint32Array(a.words)), a.w, a.h).words];"""
    words = rgbe9995.pack(small)
    for w, h in ((4, 3), (13, 9)):
        large = np.array(node.call("scene/enlarge", body, {"words": words.ravel().tolist(), "w": w, "h": h}), np.uint32)
        y = np.clip((np.arange(h) + 0.5) * 3 / h - 0.5, 0, 2)
        x = np.clip((np.arange(w) + 0.5) * 4 / w - 0.5, 0, 3)
        hat_y = np.maximum(0, 1 - abs(y[:, None] - np.arange(3)))
        hat_x = np.maximum(0, 1 - abs(x[:, None] - np.arange(4)))
        expected = np.einsum("yi,xj,ijc->yxc", hat_y, hat_x, rgbe9995.unpack(words))
        found = rgbe9995.unpack(large.reshape(h, w))
        np.testing.assert_allclose(found, expected, atol=expected.max() * 2**-9)


def test_view_picture_packet_is_decoded(node: Node) -> None:
    generator = np.random.default_rng(5)
    rects = [Tile(0, 0, 9, 6), Tile(9, 0, 4, 6), Tile(0, 6, 9, 5), Tile(9, 6, 4, 5)]
    means = [2.0 ** generator.uniform(-20, 14, (3, rect.h, rect.w)).astype(np.float32) for rect in rects]
    alphas = [generator.integers(0, 256, (rect.h, rect.w), np.uint8) for rect in rects]
    together = enumerate(zip(rects, means, alphas, strict=True))
    tiles = [ViewTile(rect, mean, number + 1, number % 2 == 1, alpha) for number, (rect, mean, alpha) in together]
    message = encode_view(tiles, (13, 11), (26, 22), 7, 9)
    body = """
        const { id, seq, width, height, tiles } = await m.decodeView(new Uint8Array(a).buffer);
        const plain = ({ words, alpha, ...rest }) => ({ ...rest, words: [...words], alpha: [...alpha] });
        return { about: [id, seq, width, height], tiles: tiles.map(plain) };"""
    found = node.call("scene/view-packet", body, list(message))
    assert found["about"] == [7, 9, 13, 11]
    heads = [(*tile.rect, tile.samples + tile.is_exact * EXACT) for tile in tiles]
    for tile, told, expected in zip(tiles, found["tiles"], unpacked(heads, body_of(message)[: -13 * 11]), strict=True):
        assert [told[name] for name in ("x", "y", "w", "h", "spp", "isExact")] == [*tile.rect, tile.samples, tile.is_exact]
        assert tile.alpha is not None and told["alpha"] == tile.alpha.ravel().tolist()
        words = np.array(told["words"], np.uint32).reshape(expected.shape)
        if tile.is_exact:
            np.testing.assert_array_equal(words, expected)
        else:
            ours, theirs = rgbe9995.unpack(expected), rgbe9995.unpack(words)
            assert (abs(theirs - ours) <= 2**-8 * ours.max(-1, keepdims=True)).all(), "but for how a half is rounded"


def test_drag_rotates_light_and_changes_strength(node: Node) -> None:
    def dragged(across: float, up: float, rotation: float = 0, strength: float = 1) -> dict[str, float]:
        before = {"rotation": rotation, "strength": strength}
        body = "return m.dragged(a.before, a.moved, { width: 720, height: 400 });"
        return dict(node.call("scene/light-math", body, {"before": before, "moved": {"across": across, "up": up}}))

    assert dragged(183, 10) == {"rotation": -90, "strength": 1}, "what lies behind follows; a hand that goes sideways trembles"
    assert dragged(-363, 0, rotation=90) == {"rotation": -90, "strength": 1}, "around and around"
    assert dragged(2, 116) == {"rotation": 0, "strength": 2}
    assert dragged(0, -116, strength=0.5) == {"rotation": 0, "strength": 0.25}
    assert dragged(0, 116, strength=0)["strength"] > 0, "out of darkness too"


def test_sun_direction_follows_from_highlight(node: Node) -> None:
    random = np.random.default_rng(5)
    for _ in range(20):
        sight, normal = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
        scaled = [list(sight), list(float(random.uniform(-2, 2)) * normal)]
        sun = node.call("scene/light-math", "return m.sunFor({ direction: a[0], normal: a[1] });", scaled)
        elevation, azimuth = math.radians(sun["elevation"]), math.radians(sun["azimuth"])
        level = math.cos(elevation)
        found = np.array([level * math.sin(azimuth), math.sin(elevation), -level * math.cos(azimuth)])
        half = found - sight  # half vector between the sun and the eye
        mirrored = sight - 2 * (sight @ normal) * normal
        assert sun["isRaised"] == (mirrored[1] < math.sin(math.radians(2)))
        if not sun["isRaised"]:
            assert abs(half @ normal) == pytest.approx(np.linalg.norm(half), abs=1e-6)
        else:
            assert sun["elevation"] == 2
            assert found[0] * mirrored[2] == pytest.approx(found[2] * mirrored[0], abs=1e-6), "on that side"
    sky = node.call("scene/light-math", "return m.sunFor({ direction: [0.6, 0.8, 0], normal: null });")
    assert (sky["azimuth"], sky["elevation"]) == pytest.approx((90, 53.13), abs=0.01)


def test_view_follows_scene_centre_when_up_axis_changes(node: Node) -> None:
    """When another axis of the scene becomes the up axis, the view follows the centre of the rotated scene.

    The view keeps its direction and distance. The rotations are those of the scene reader.
    """
    bounds = np.array([[-1.0, 0.0, 2.0], [3.0, 5.0, 4.0]])
    centre = bounds.mean(axis=0)
    for before, a in ROTATIONS.items():
        for after, b in ROTATIONS.items():
            shown = ROTATIONS["z"][:3, :3]
            given = {"view": VIEW, "bounds": bounds.tolist(), "before": before, "after": after}
            moved = node.call("forms/stand-fields", 'return m.withAxis(a.view, a.bounds, "z", a.before, a.after);', given)
            step = (b[:3, :3] - a[:3, :3]) @ shown.T @ centre
            for name in ("eye", "target"):
                np.testing.assert_allclose(vector(moved, name), vector(VIEW, name) + step, atol=1e-12)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "is_same"),
    [
        ({}, True),
        ({"eye": [3, 2, 5.00001], "aperture": 0.1, "height": 7, "focus": None}, True),
        ({"eye": [3, 2, 5.1]}, False),
        ({"fov": 41}, False),
        ({"shift_x": 0.1}, False),
        ({"projection": "orthographic", "height": 4}, False),
    ],
)
def test_views_are_the_same_if_they_show_the_same_part_of_the_scene(node: Node, change: dict[str, object], is_same: bool) -> None:
    assert node.call("scene/orbit", "return m.isSameView(...a);", [VIEW, {**VIEW, **change}]) is is_same


def test_zoomed_orthographic_views_differ(node: Node) -> None:
    flat = {**VIEW, "projection": "orthographic", "height": 4}
    body = "return [m.isSameView(a, {...a, fov: 20}), m.isSameView(a, {...a, height: 3})];"
    assert node.call("scene/orbit", body, flat) == [True, False]


def test_take_fills_the_form_but_keeps_its_goals(node: Node) -> None:
    light = {"color": [1, 2, 3], "strength": 2, "rotation": 90}
    request = {"scene": "s", "camera": "front", "width": 300, "frame": 7.5, "clip": "walk", "variant": "1", "up": "z"}
    now = {"spp": 64, "noise": 0.1, "denoise": True, "environment": {"preset": "studio"}, "frames": "0-9"}
    body = "return m.startOfTake({ request: a[0] }, a[1]);"
    start = node.call("scene/form-start", body, [{**request, "environment": light}, now])
    kept = {"noise": 0.1, "seconds": None}
    colour = {"environment": [1, 2, 3], "environment_strength": 2, "environment_rotation": 90}
    assert start["first"].items() >= {"width": 300, "light": light, **kept, **colour}.items()
    assert (start["camera"], start["view"], start["variant"], start["up"], start["denoise"]) == ("front", None, "1", "z", True)
    assert (start["shot"]["frames"], start["shot"]["count"], start["shot"]["clip"]) == ("7.5", 1, "walk")


def test_image_that_waits_for_a_scene_lights_no_other_one(node: Node) -> None:
    body = """
        const lit = [];
        const open = (scene) => m.registerLightReceiver((file) => lit.push([scene, file]), scene)();
        m.holdLight("a.hdr", "one");
        open("two");
        open("one"); // it was opened too late
        m.holdLight("b.hdr", "one");
        open("one");
        open("one");
        await null;
        return lit;"""
    assert node.call("shell/light-drop", body) == [["one", "b.hdr"]]


def test_modules_call_what_the_scripts_in_the_head_define(node: Node) -> None:
    body = """
        globalThis.window = {};
        for (const name of ["again", "ahead"]) await read(`/js/shell/${name}.js`);
        const { rayfarmAgain: again, rayfarmViews: ahead } = window;
        delete globalThis.window;
        return { again: Object.keys(again), ahead: Object.keys(ahead) };"""
    defined = node.call("scene/replacement", body)
    for module, name, call in (
        ("main", "again", r"rayfarmAgain\.(\w+)\("),
        ("views/showing", "again", r"\bagain\.(\w+)\("),
        ("views/showing", "ahead", r"\bahead\.(\w+)\("),
    ):
        called = set(re.findall(call, (ROOT / "web" / "js" / f"{module}.js").read_text(encoding="utf-8")))
        assert called, module
        assert called <= set(defined[name]), module


def test_picture_is_not_of_the_latest_request_while_another_waits_for_the_next_frame(node: Node) -> None:
    """Otherwise the picture of the former light would set the exposure of a new one."""
    body = """
        const frames = [];
        const requestAnimationFrame = (run) => frames.push(run);
        Object.assign(globalThis, { requestAnimationFrame, cancelAnimationFrame: () => {}, WebSocket: { OPEN: 1 } });
        const link = Object.create(m.ViewLink.prototype);
        Object.assign(link, { id: 3, pending: 0, socket: { readyState: 1 }, handlers: { asked() {} }, send() {} });
        const found = [link.isLatest(3)];
        link.show({ environment: { preset: "studio" } });
        found.push(link.isLatest(3));
        frames[0]();
        return [...found, link.isLatest(3), link.isLatest(4)];"""
    assert node.call("scene/view-link", body) == [True, False, False, True]


def test_other_side_is_seen_from_the_same_height(node: Node) -> None:
    """Turned twice, the camera is where it was. Up need not be of unit length, nor an axis."""
    for up in ([0.0, 0.0, 2.0], [0.6, 0.8, 0.0]):
        view = {"eye": [4.0, -3.0, 2.0], "target": [1.0, 1.0, 0.5], "up": up}
        once, twice = node.call("scene/other-side", "return [m.oppositeOf(a), m.oppositeOf(m.oppositeOf(a))];", view)
        axis = np.array(up) / np.linalg.norm(up)
        before, after = (np.array(each["eye"]) - view["target"] for each in (view, once))
        assert after @ axis == pytest.approx(before @ axis)
        np.testing.assert_allclose(after - (after @ axis) * axis, -(before - (before @ axis) * axis), atol=1e-12)
        np.testing.assert_allclose(twice["eye"], view["eye"], atol=1e-12)
