"""Tests that an uploaded scene is drawn as a mesh until path-traced samples arrive, and rotates as the live view does."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, Route, expect

from tests.e2e.conftest import Watched
from tests.e2e.small_glb import small_glb
from tests.helpers import Farm, wait_until

# Counts the frames without the mesh, after the first with it.
WATCH_MESH = """(() => {
  window.framesWithoutMesh = 0;
  let isSeen = false;
  const look = () => {
    const meshes = [...document.querySelectorAll(".live-view canvas.mesh")];
    const isShown = meshes.some((canvas) => canvas.dataset.drawn && !canvas.hidden);
    isSeen ||= isShown;
    if (isSeen && !isShown) window.framesWithoutMesh++;
    requestAnimationFrame(look);
  };
  look();
})()"""

# Delays news of a scene until the page has polled for its preview.
DELAY_NEWS = """(() => {
  const listen = EventSource.prototype.addEventListener;
  EventSource.prototype.addEventListener = function (type, listener) {
    listen.call(this, type, type === "scene" ? (event) => setTimeout(listener, 2000, event) : listener);
  };
})()"""


def live_view_pixels(page: Page) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(page.locator(".live-view").screenshot())).convert("RGB")).astype(int)


@pytest.mark.long  # test_page.py tests the first picture
def test_preview_mesh_is_shown_until_samples_arrive(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.set_viewport_size({"width": 800, "height": 480})
    page.route_web_socket("**/viewport", lambda socket: None)  # keeps samples from arriving
    held: list[Route] = []
    page.route("**/js/views/jobs.js", lambda route: held.append(route))
    page.add_init_script(WATCH_MESH)
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    chooser.value.set_files([{"name": "cube.glb", "mimeType": "model/gltf-binary", "buffer": small_glb("preview")}])
    expect(page.locator(".live-view canvas:not(.mesh)").first).to_be_attached(timeout=90_000)  # of the scene that is ready
    mesh = page.locator(".live-view canvas.mesh")
    expect(mesh).to_be_visible()
    assert page.evaluate("framesWithoutMesh") == 0, "the live view takes the canvas of the scene that was prepared"
    expect(mesh).to_have_attribute("data-drawn", "16")  # triangles of a cube, a floor and a lamp
    first = live_view_pixels(page)
    red = (first[..., 0] > 2 * first[..., 1]) & (first[..., 0] > 60)
    assert 0.01 < red.mean() < 0.6, "the red cube"

    box = page.locator(".live-view").bounding_box()
    assert box
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 220, box["y"] + 120, steps=4)
    page.mouse.up()
    wait_until(lambda: np.abs(live_view_pixels(page) - first).mean() > 2, 20, "the mesh turns")
    wait_until(lambda: mesh.evaluate("canvas => canvas.width === canvas.clientWidth"), 20, "sharp at rest, where frames are slow")

    page.get_by_role("link", name="Jobs").first.click()
    expect(page.locator("main")).to_have_attribute("aria-busy", "true")
    expect(page.locator(".scene-page.workspace canvas.mesh")).to_be_visible()  # whole, until the next view is loaded
    wait_until(lambda: bool(held), 20, "the module is requested")
    for route in held:
        route.continue_()
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
    assert watched.errors == []


@pytest.mark.long
def test_late_answer_does_not_undo_a_scene_that_is_ready(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.route_web_socket("**/viewport", lambda socket: None)
    held: list[tuple[Route, dict[str, object]]] = []

    def hold(route: Route) -> None:
        held.append((route, route.fetch().json()))

    page.route("**/api/scenes/*", hold)
    page.add_init_script(DELAY_NEWS)
    page.add_init_script(WATCH_MESH)
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    chooser.value.set_files([{"name": "late.glb", "mimeType": "model/gltf-binary", "buffer": small_glb("late")}])
    live = page.locator(".live-view canvas:not(.mesh)").first
    expect(live).to_be_attached(timeout=90_000)
    mesh = page.locator(".live-view canvas.mesh")
    expect(mesh).to_have_attribute("data-drawn", "16")
    live.evaluate("canvas => canvas.dataset.first = true")
    [(route, scene)] = held
    with page.expect_response(route.request.url):
        route.fulfill(json=scene | {"status": "preparing", "preview": True})
    page.evaluate("new Promise((done) => setTimeout(() => requestAnimationFrame(() => requestAnimationFrame(done)), 200))")
    expect(live).to_have_attribute("data-first", "true")  # the view stays open
    assert page.evaluate("framesWithoutMesh") == 0
    assert watched.errors == []


@pytest.mark.long
def test_file_that_needs_blender_says_what_to_do(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.goto(farm.url)
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files").click()
    blend = b"BLENDER-v402" + bytes(64)
    chooser.value.set_files([{"name": "room.blend", "mimeType": "application/octet-stream", "buffer": blend}])
    notice = page.locator(".live-view-frame .empty")
    expect(notice).to_contain_text("This file needs Blender")
    expect(notice).to_contain_text("farm.py up --blender")
    expect(page.locator(".preparing-panel > p")).to_have_text("Waiting for a worker with Blender …")
    expect(page.locator(".view-pills > p")).to_be_hidden()
    page.request.delete(f"{farm.url}/api/scenes/{page.url.partition('/scenes/')[2].partition('?')[0]}")
    assert watched.errors == []


# Draws a cube on the studio's floor, once or until its shadows are done; by default seen from above, and in the studio.
# Returns the colours of some points, 0 ... 255.
DRAW_CUBE = """async ([obj, points, isRefined, seenBy, light = {}]) => {
  const view = seenBy ?? { eye: [0, 14, 0], target: [0, 0, 0], up: [0, 0, -1], fov: 40 };
  const { MeshCanvas } = await import("/js/scene/mesh-canvas.js");
  const { clipMatrix } = await import("/js/scene/mesh-camera.js");
  const { meshOf } = await import("/js/mesh/upload.js");
  const { packet } = await meshOf({ files: [{ path: "cube.obj", file: new File([obj], "cube.obj") }], formats: [".obj"] });
  const canvas = document.createElement("canvas");
  canvas.style.cssText = "position: fixed; top: 0; left: 0; width: 400px; height: 400px";
  document.body.append(canvas);
  const mesh = new MeshCanvas(canvas);
  mesh.floor = true;
  mesh.setMesh({ ...packet, textures: [] });
  mesh.relight(light);
  mesh.setView(view);
  mesh.draw();
  while (isRefined && (mesh.settling !== undefined || mesh.isRefining)) {
    mesh.refine();
    await new Promise(requestAnimationFrame);
  }
  if (isRefined) mesh.draw();
  const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
  copy.drawImage(canvas, 0, 0);
  const toClip = clipMatrix(view, 1, packet.low, packet.high);
  const middle = packet.low.map((value, i) => (value + packet.high[i]) / 2);
  return points.map((point) => {
    const along = (row) => [0, 1, 2].reduce((sum, i) => sum + toClip[4 * i + row] * (point[i] - middle[i]), toClip[12 + row]);
    const [x, y] = [0.5 + along(0) / along(3) / 2, 0.5 - along(1) / along(3) / 2];
    return copy.getImageData(Math.floor(x * canvas.width), Math.floor(y * canvas.height), 1, 1).data.slice(0, 3).join(" ");
  }).map((color) => color.split(" ").map(Number));
}"""
CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (0, 2) for z in (-1, 1))
CUBE += "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"


@pytest.mark.long
def test_preview_shadow_falls_away_from_the_key_light(farm: Farm, watched: Watched) -> None:
    """The studio's key light is at the left front: from the first frame on the floor is darker behind a cube than before it."""
    page = watched.page
    page.goto(farm.url)
    towards, away, far = [-1.5, 0, 1.4], [1.5, 0, -1.4], [-3.6, 0, 3.6]
    lit, shadowed, open_floor = (color[1] for color in page.evaluate(DRAW_CUBE, [CUBE, [towards, away, far], False]))
    assert shadowed < lit - 12
    assert open_floor == pytest.approx(181, abs=8)
    lit, shadowed, open_floor = (color[1] for color in page.evaluate(DRAW_CUBE, [CUBE, [towards, away, far], True]))
    assert shadowed < lit - 12
    assert lit <= open_floor
    assert open_floor == pytest.approx(181, abs=5), "as the path tracer's"
    assert watched.errors == []


@pytest.mark.long
def test_floor_of_a_preview_ends_where_the_renderer_ends_it(farm: Farm, watched: Watched) -> None:
    """The floor is not blurred into the backdrop: its far edge, 30 diagonals of the bounds away, is sharp."""
    page = watched.page
    page.goto(farm.url)
    view = {"eye": [0, 6, 9], "target": [0, 4, 0], "up": [0, 1, 0], "fov": 40}
    end = -30 * math.sqrt(12)
    points = [[3, 0, -20], [2, 0, end + 10], [2, 0, end - 14], [2, 12, end]]
    found = page.evaluate(DRAW_CUBE, [CUBE, points, True, view, {"color": [0.5, 0.5, 0.5]}])
    near, inside, outside, sky = (color[1] for color in found)
    assert inside == pytest.approx(near, abs=2)
    assert outside == pytest.approx(sky, abs=2)
    assert sky > near + 20
    assert watched.errors == []


def _box(low: tuple[float, float, float], high: tuple[float, float, float], before: int) -> str:
    """Returns an OBJ's box. before: corners of those before it."""
    corners = "".join(f"v {x} {y} {z}\n" for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2]))
    faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    return corners + "".join(f"f {' '.join(str(int(corner) + before) for corner in face.split())}\n" for face in faces)


FEET = [(-1.8, -1.3), (1.6, -1.3), (-1.8, 1.1), (1.6, 1.1)]
TABLE = _box((-2, 0.3, -1.5), (2, 1.6, 1.5), 0)
TABLE += "".join(_box((x, 0, z), (x + 0.2, 0.3, z + 0.2), 8 * (i + 1)) for i, (x, z) in enumerate(FEET))


@pytest.mark.long
def test_floor_of_a_preview_is_nearly_black_below_a_low_body(farm: Farm, watched: Watched) -> None:
    """The floor below a white table is dark: the white feet and the bottom above it receive almost no light to reflect."""
    page = watched.page
    page.goto(farm.url)
    view = {"eye": [0, 0.9, 14], "target": [0, 0.8, 0], "up": [0, 1, 0], "fov": 30}
    below = [[0, 0, z] for z in (0.6, 0, -0.6)]
    assert max(color[1] for color in page.evaluate(DRAW_CUBE, [TABLE, below, False, view])) < 55
    assert max(color[1] for color in page.evaluate(DRAW_CUBE, [TABLE, below, True, view])) < 30
    assert watched.errors == []


def _pot(sides: int = 48) -> str:
    """Returns an OBJ of a round body, narrower at its bottom, of radius 1."""
    turns = [2 * math.pi * i / sides for i in range(sides)]
    obj = "".join(
        f"v {r * math.cos(turn)} {y} {r * math.sin(turn)}\n" for y, r in ((0, 1), (0.3, 1.25), (1.5, 1.25)) for turn in turns
    )
    corners = range(1, sides + 1)
    for low in (0, sides):
        obj += "".join(f"f {low + i} {low + sides + i} {low + sides + i % sides + 1} {low + i % sides + 1}\n" for i in corners)
    return obj + f"f {' '.join(str(i) for i in corners)}\nf {' '.join(str(3 * sides + 1 - i) for i in corners)}\n"


@pytest.mark.long
def test_first_floor_of_a_preview_is_darkest_along_a_round_body(farm: Farm, watched: Watched) -> None:
    """From the first frame on: what the floor's map has below the body does not lighten the floor beside it."""
    page = watched.page
    page.goto(farm.url)
    view = {"eye": [0, 4, 12], "target": [0, 0.5, 0], "up": [0, 1, 0], "fov": 22}
    turns = [math.radians(degrees) for degrees in range(24, 55, 3)]
    points = [[r * math.sin(turn), 0, r * math.cos(turn)] for r in (1.04, 1.1) for turn in turns]
    beside, farther = np.array(page.evaluate(DRAW_CUBE, [_pot(), points, False, view]))[:, 1].reshape(2, -1).mean(axis=1)
    assert beside < farther - 18
    assert watched.errors == []


@pytest.mark.long
def test_floor_hides_a_preview_from_below(farm: Farm, watched: Watched) -> None:
    """From below, the preview shows the lower side of the floor, lit by the weaker light from below."""
    page = watched.page
    page.goto(farm.url)
    view = {"eye": [0, -3, 9], "target": [0, 1, 0], "up": [0, 1, 0], "fov": 40}
    for is_refined in (False, True):
        colors = [color[1] for color in page.evaluate(DRAW_CUBE, [CUBE, [[0, 1, 1], [3, 0, 0], [-3, 3, 0]], is_refined, view])]
        assert len(set(colors)) == 1
        assert colors[0] == pytest.approx(75, abs=3), "as the path tracer's"
    assert watched.errors == []


# The same in the light of a sun, on a canvas that is large enough for shadows of half its resolution.
SUN = "{ at: [-0.7, 0.6, 0.4], far: true, color: [1, 0.8, 0.6], axis: [0, 0, 0], cosines: [-2, -1] }"
DRAW_IN_SUN = DRAW_CUBE.replace("textures: [] }", f"textures: [], lamps: [{SUN}] }}").replace("400px", "1000px")
FROM_ABOVE = {"eye": [0, 9, 6], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 50}


@pytest.mark.long
def test_shadow_of_the_sun_in_a_preview_has_a_smooth_edge(farm: Farm, watched: Watched) -> None:
    """The edge of the sun's shadow is smooth: along it the floor has half the brightness of the sunlit floor everywhere."""
    page = watched.page
    page.set_viewport_size({"width": 1000, "height": 1000})
    page.goto(farm.url)
    edge = [[1 + 0.7 * t, 0, 1 - 0.4 * t] for t in np.arange(0.5, 2.5, 0.05)]
    for is_refined, most in ((False, 15), (True, 7)):
        colors = np.array(page.evaluate(DRAW_IN_SUN, [CUBE, edge, is_refined, FROM_ABOVE, {"color": [0.3, 0.4, 0.6]}]))
        assert colors[:, 1].std() < most
        assert 110 < colors[:, 1].mean() < 150
    assert watched.errors == []


@pytest.mark.long
def test_shadow_of_the_sun_in_a_preview_has_the_colour_of_the_sky(farm: Farm, watched: Watched) -> None:
    """The shadow of a yellow cube stays blue: the cube reflects no light of the sunlit floor into it."""
    page = watched.page
    page.set_viewport_size({"width": 1000, "height": 1000})
    page.goto(farm.url)
    yellow = "".join(f"{line} 0.8 0.7 0.02\n" if line.startswith("v") else f"{line}\n" for line in CUBE.splitlines())
    shadow = [[1.3 + 0.7 * t, 0, -0.4 * t] for t in (0, 0.4, 0.8, 1.2)]
    for is_refined in (False, True):
        for red, _, blue in page.evaluate(DRAW_IN_SUN, [yellow, shadow, is_refined, FROM_ABOVE, {"color": [0.03, 0.04, 0.06]}]):
            assert red < blue < 40
    assert watched.errors == []


KEEP = """const picture = new OffscreenCanvas(40, 40);
  const paint = picture.getContext("2d");
  paint.fillStyle = "#00ff00";
  paint.fillRect(0, 0, 40, 40);
  mesh.keep(picture, { eye: [0, 3, 12], target: [0, 1, 0], up: [0, 1, 0], fov: 30 });
  mesh.draw();
  const copy ="""


@pytest.mark.long
def test_kept_picture_has_its_floor_as_far_as_the_renderer(farm: Farm, watched: Watched) -> None:
    """While the camera turns, the floor has the colour of a kept picture where that shows it, else its own light."""
    page = watched.page
    page.goto(farm.url)
    view = {"eye": [0, 3, -12], "target": [0, 1, 0], "up": [0, 1, 0], "fov": 30}
    known, other = [[0, 0, -3]], [[0, 0, 30], [3, 0, 30], [10, 0, 60]]
    found = page.evaluate(DRAW_CUBE.replace("const copy =", KEEP), [CUBE, known + other, False, view])
    assert found[0] == [0, 255, 0]
    assert found[1:] == [[pytest.approx(181, abs=3)] * 3] * 3
    assert watched.errors == []


@pytest.mark.long
def test_first_shadow_of_a_preview_is_slightly_tinted_and_without_steps(farm: Farm, watched: Watched) -> None:
    """A slight tint of a red cube, as in the path tracer's picture, no black at the contact, and no edges of directions."""
    page = watched.page
    page.goto(farm.url)
    red = "".join(f"{line} 0.8 0.02 0.02\n" if line.startswith("v") else f"{line}\n" for line in CUBE.splitlines())
    line = [[1.25 + 0.05 * i, 0, -1.25 - 0.05 * i] for i in range(40)]
    across = [[1.35 + 0.02 * i, 0, 1 - 0.05 * i] for i in range(40)]
    for points in (line, across):
        colors = np.array(page.evaluate(DRAW_CUBE, [red, points, False]), dtype=int)
        tint = colors[:, 0] - colors[:, 1]
        assert 3 < tint.max() <= 14, "slight"
        assert np.abs(colors[:, 1] - colors[:, 2]).max() <= 3, "red"
        assert colors.min() > 60, "never black"
        assert np.abs(np.diff(colors[:, 1])).max() <= 9, "without steps"
    assert watched.errors == []


@pytest.mark.long
def test_sheet_below_a_red_body_is_tinted_in_a_preview(farm: Farm, watched: Watched) -> None:
    """A white sheet receives the red of the cube that stands on it, as the studio's floor does, and not its own colour."""
    page = watched.page
    page.goto(farm.url)
    sheet = "".join(f"v {x} 0 {z} 0.9 0.9 0.9\n" for x, z in ((-3, -3), (-3, 3), (3, 3), (3, -3))) + "f 1 2 3 4\n"
    red = "".join(f"{line} 0.8 0.02 0.02\n" for line in CUBE.splitlines() if line.startswith("v"))
    faces = [line.split()[1:] for line in CUBE.splitlines() if line.startswith("f")]
    red += "".join(f"f {' '.join(str(int(corner) + 4) for corner in face)}\n" for face in faces)
    for is_refined in (False, True):
        beside, away = page.evaluate(DRAW_CUBE, [sheet + red, [[-1.3, 0, 0], [-2.5, 0, 2.5]], is_refined])
        assert beside[0] > beside[1] + 6, f"{beside}"
        assert away[0] <= away[1] + 3, f"{away}"
    assert watched.errors == []


@pytest.mark.long
def test_upright_sheet_lights_the_floor_of_a_preview(farm: Farm, watched: Watched) -> None:
    """Before a sheet that faces the key light, the floor is hardly darker than elsewhere: the sheet reflects light onto it."""
    page = watched.page
    page.goto(farm.url)
    sheet = "v -1 0 0\nv 1 0 0\nv 1 2 0\nv -1 2 0\nf 1 2 3 4\n"
    near, away = page.evaluate(DRAW_CUBE, [sheet, [[0, 0, 0.5], [-2.5, 0, 2.5]], True])
    assert away[1] - 12 < near[1] <= away[1]
    assert watched.errors == []


@pytest.mark.long
def test_box_with_smoothed_normals_has_sharp_edges_in_a_preview(farm: Farm, watched: Watched) -> None:
    """Normals that point away from the middle of a cube, as in old FBX files, do not blur its edges."""
    page = watched.page
    page.goto(farm.url)
    out = "".join(f"vn {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
    faces = [line.split()[1:] for line in CUBE.splitlines() if line.startswith("f")]
    smooth = CUBE.partition("f ")[0] + out + "".join("f " + " ".join(f"{k}//{k}" for k in face) + "\n" for face in faces)
    view = {"eye": [4, 3, 6], "target": [0, 1, 0], "up": [0, 1, 0], "fov": 30}
    heights = [1.3, 1.5, 1.7]
    left = [[x, y, 1] for y in heights for x in (0.8, 0.95)]
    right = [[1, y, z] for y in heights for z in (0.8, 0.95)]
    for is_refined in (False, True):
        colors = np.array(page.evaluate(DRAW_CUBE, [smooth, left + right, is_refined, view]), dtype=int)[:, 1].reshape(2, 3, 2)
        print(colors)
        assert (colors[0, :, 1] - colors[1, :, 1]).min() > 5, f"an edge: {colors}"
        assert np.abs(np.diff(colors)).max() <= 7, f"without a bevel: {colors}"
    assert watched.errors == []


# A box that is open at the top, deep and narrow: a small part of the light reaches its inside.
WELL = "".join(f"v {x} {y} {z}\n" for x in (-0.4, 0.4) for y in (0.5, 2.5) for z in (-0.4, 0.4))
WELL += "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 1 3 7 5\nf 2 6 8 4\n"


@pytest.mark.long
def test_inside_of_a_well_is_dark_in_a_preview(farm: Farm, watched: Watched) -> None:
    """Surfaces in a cavity reflect little light, since little reaches them."""
    page = watched.page
    page.goto(farm.url)
    view = {"eye": [1.2, 9, 0], "target": [-0.4, 1.4, 0], "up": [0, 0, -1], "fov": 40}
    for is_refined in (False, True):
        ((wall, _, _), (floor, _, _)) = page.evaluate(DRAW_CUBE, [WELL, [[-0.4, 1.4, 0], [-2, 0, 2]], is_refined, view])
        assert wall < 0.8 * floor
    assert watched.errors == []


# Draws a metal floor before a wall in several lights, one after the other. Returns the colours of pixels, 0 ... 255; by default
# of the middle of the floor.
DRAW_MIRROR = """async ([obj, mtl, lights, points = [[100, 100]]]) => {
  const { MeshCanvas } = await import("/js/scene/mesh-canvas.js");
  const { meshOf } = await import("/js/mesh/upload.js");
  const files = [["mirror.obj", obj], ["mirror.mtl", mtl]].map(([path, text]) => ({ path, file: new File([text], path) }));
  const { packet } = await meshOf({ files, formats: [".obj"] });
  const canvas = document.createElement("canvas");
  canvas.style.cssText = "position: fixed; top: 0; left: 0; width: 200px; height: 200px";
  document.body.append(canvas);
  const mesh = new MeshCanvas(canvas);
  mesh.setMesh({ ...packet, textures: [] });
  mesh.setView({ eye: [0, 1, 4], target: [0, 0, 0], up: [0, 1, 0], fov: 40 });
  mesh.draw(); // where WebGL is slow, a first frame does without mirrors
  const copy = new OffscreenCanvas(200, 200).getContext("2d");
  return lights.flatMap((light) => {
    mesh.relight(light);
    mesh.draw();
    copy.drawImage(canvas, 0, 0, 200, 200);
    return points.map(([x, y]) => [...copy.getImageData(x, y, 1, 1).data.slice(0, 3)]);
  });
}"""
MIRROR = "mtllib mirror.mtl\nv -3 0 -3\nv 3 0 -3\nv 3 0 3\nv -3 0 3\nv -3 2 -3\nv 3 2 -3\n"
MIRROR += "usemtl metal\nf 4 3 2 1\nusemtl wall\nf 1 2 6 5\n"


@pytest.mark.long
def test_metal_of_a_preview_shows_the_other_surfaces(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.goto(farm.url)
    materials = "newmtl metal\nKd 0.9 0.9 0.9\nPm 1\nPr 0\nnewmtl wall\nKd 0.8 0.02 0.02\n"
    [[red, green, _]] = page.evaluate(DRAW_MIRROR, [MIRROR, materials, [{}]])
    assert red > 2 * green + 20
    white = materials.replace("0.8 0.02 0.02", "0.8 0.8 0.8")
    own, chosen = page.evaluate(DRAW_MIRROR, [MIRROR, white, [{}, {"color": [0.02, 1, 0.02]}]])
    assert own[1] < 1.5 * own[0] + 20
    assert chosen[1] > 2 * chosen[0] + 20, "in the light that is chosen"
    metal = materials + "Pm 1\nPr 0.1\n"
    [[red, green, _]] = page.evaluate(DRAW_MIRROR, [MIRROR, metal, [{}]])
    assert red > 2 * green + 20, "mirrors show each other"
    assert watched.errors == []


@pytest.mark.long
def test_metal_of_a_preview_shows_what_is_near_in_its_place(farm: Farm, watched: Watched) -> None:
    """A low wall is reflected directly before it, and not far before it."""
    page = watched.page
    page.goto(farm.url)
    low = "v -1 0 -0.25\nv 1 0 -0.25\nv 1 0.25 -0.25\nv -1 0.25 -0.25\nusemtl wall\nf 7 8 9 10\n"
    post = "v -3 2 -3\nv -2.9 2 -3\nv -3 0 -3\nf 11 12 13\n"
    floor = MIRROR.split("usemtl wall")[0]
    materials = "newmtl metal\nKd 0.9 0.9 0.9\nPm 1\nPr 0\nnewmtl wall\nKd 0.8 0.02 0.02\n"

    def row(z: float) -> float:
        """Returns the row of the picture at which a point (0, 0, z) is seen from (0, 1, 4) towards the origin."""
        forward, up = np.array([0, -1, -4]) / 17**0.5, np.array([0, 4, -1]) / 17**0.5
        way = np.array([0, -1, z - 4])
        return float(100 - 100 * (way @ up) / (way @ forward) / math.tan(math.radians(20)))

    before, far = page.evaluate(
        DRAW_MIRROR, [floor + low + post, materials, [{}], [[100, round(row(0.2))], [100, round(row(1.5))]]]
    )
    assert before[0] > 2 * before[1] + 20
    assert far[0] < 1.5 * far[1] + 20
    assert watched.errors == []


@pytest.mark.long
def test_metal_of_a_preview_shows_the_colour_of_what_shines(farm: Farm, watched: Watched) -> None:
    """A dark metal reflects the blue of a surface that is itself shown white, as it is too bright."""
    page = watched.page
    page.goto(farm.url)
    shape = MIRROR.split("usemtl wall")[0] + "v 0 4 -3\nusemtl glow\nf 1 2 7\n"
    materials = "newmtl metal\nKd 0.2 0.2 0.2\nPm 1\nPr 0\nnewmtl glow\nKd 0 0 0\nKe 0.6 1.5 3\n"
    [[red, _, blue]] = page.evaluate(DRAW_MIRROR, [shape, materials, [{}]])
    assert blue > 1.85 * red, f"{red} {blue}"
    assert watched.errors == []


# Draws a floor below a pane in the light of four lamps above, and a small pyramid around a weak blue one.
# Returns the colours of points of the floor, 0 ... 255.
DRAW_PANE = """async ([obj, mtl, points]) => {
  const { MeshCanvas } = await import("/js/scene/mesh-canvas.js");
  const { clipMatrix } = await import("/js/scene/mesh-camera.js");
  const { meshOf } = await import("/js/mesh/upload.js");
  const files = [["pane.obj", obj], ["pane.mtl", mtl]].map(([path, text]) => ({ path, file: new File([text], path) }));
  const { packet } = await meshOf({ files, formats: [".obj"] });
  const lamp = { far: false, axis: [0, 0, 0], cosines: [-2, -1] };
  const strong = Array(4).fill({ ...lamp, at: [0, 4, 0], color: [0.1, 0.1, 0.1] });
  const lamps = [...strong, { ...lamp, at: [-1.4, 0.4, 0], color: [0, 0, 0.05] }];
  const canvas = document.createElement("canvas");
  canvas.style.cssText = "position: fixed; top: 0; left: 0; width: 200px; height: 200px";
  document.body.append(canvas);
  const mesh = new MeshCanvas(canvas);
  mesh.setMesh({ ...packet, textures: [], lamps, isStudio: false, environment: null });
  const view = { eye: [0, 5, 5], target: [0, 0, 0], up: [0, 1, 0], fov: 50 };
  mesh.setView(view);
  mesh.draw();
  const copy = new OffscreenCanvas(200, 200).getContext("2d");
  copy.drawImage(canvas, 0, 0, 200, 200);
  const toClip = clipMatrix(view, 1, packet.low, packet.high);
  const middle = packet.low.map((value, i) => (value + packet.high[i]) / 2);
  return points.map((point) => {
    const along = (row) => [0, 1, 2].reduce((sum, i) => sum + toClip[4 * i + row] * (point[i] - middle[i]), toClip[12 + row]);
    return [...copy.getImageData(100 + (100 * along(0)) / along(3), 100 - (100 * along(1)) / along(3), 1, 1).data.slice(0, 3)];
  });
}"""
PANE = "mtllib pane.mtl\nv -3 0 -3\nv 3 0 -3\nv 3 0 3\nv -3 0 3\nusemtl floor\nf 4 3 2 1\n"
PANE += "v -0.5 1 -0.5\nv 0.5 1 -0.5\nv 0.5 1 0.5\nv -0.5 1 0.5\nusemtl pane\nf 8 7 6 5\n"
PANE += "v -1.5 0.3 -0.1\nv -1.3 0.3 -0.1\nv -1.4 0.3 0.1\nv -1.4 0.5 0\n"
PANE += "usemtl glow\nf 9 10 12\nf 10 11 12\nf 11 9 12\nf 9 11 10\n"


@pytest.mark.long
def test_lamps_of_a_preview_shine_through_a_pane_and_beside_what_glows(farm: Farm, watched: Watched) -> None:
    """A pane has a lighter shadow than a solid one; a fifth lamp, inside a surface that shines, lights what is next to it."""
    page = watched.page
    page.goto(farm.url)
    points = [[0, 0, 0], [1.4, 0, 0.4], [-1.4, 0, 0.4]]

    def colors(opacity: float) -> np.ndarray:
        materials = f"newmtl floor\nKd 0.5 0.5 0.5\nnewmtl pane\nKd 0.5 0.5 0.5\nd {opacity}\nnewmtl glow\nKd 0 0 0\nKe 0 0 3\n"
        return np.array(page.evaluate(DRAW_PANE, [PANE, materials, points]), dtype=int)

    clear, pane, solid = colors(0.02), colors(0.4), colors(1)
    assert solid[0, 0] + 20 < pane[0, 0] < clear[0, 0] - 10, f"{clear} {pane} {solid}"
    assert np.abs(clear[1] - solid[1]).max() <= 2
    assert pane[2, 2] > pane[1, 2] + 20, f"blue beside the lamp: {pane}"
    assert abs(pane[2, 0] - pane[1, 0]) <= 4, f"{pane}"
    assert watched.errors == []


@pytest.mark.long
def test_wall_of_a_preview_has_the_colour_that_the_floor_reflects(farm: Farm, watched: Watched) -> None:
    """The unlit side of a wall is red in front of a red floor."""
    page = watched.page
    page.goto(farm.url)
    shape = PANE.split("v -0.5 1")[0] + "v -0.5 0.2 0.5\nv 0.5 0.2 0.5\nv 0.5 1.5 0.5\nv -0.5 1.5 0.5\nusemtl wall\nf 5 6 7 8\n"

    def color(floor: str) -> list[int]:
        materials = f"newmtl floor\nKd {floor}\nnewmtl wall\nKd 0.9 0.9 0.9\n"
        return list(page.evaluate(DRAW_PANE, [shape, materials, [[0, 0.8, 0.5]]])[0])

    grey, red = color("0.5 0.5 0.5"), color("0.8 0.1 0.1")
    assert abs(grey[0] - grey[1]) <= 2, f"{grey}"
    assert red[0] > red[1] + 10, f"{red}"
    assert watched.errors == []


# Returns the brightness of a mesh's surroundings in lights of one colour, with another exposure on the page.
MEASURE = """async ([obj, lights]) => {
  const { MeshCanvas } = await import("/js/scene/mesh-canvas.js");
  const { meshBrightness } = await import("/js/scene/mesh-brightness.js");
  const { meshOf } = await import("/js/mesh/upload.js");
  const { packet } = await meshOf({ files: [{ path: "a.obj", file: new File([obj], "a.obj") }], formats: [".obj"] });
  const canvas = document.createElement("canvas");
  canvas.style.cssText = "position: fixed; top: 0; left: 0; width: 90px; height: 60px";
  document.body.append(canvas);
  const mesh = new MeshCanvas(canvas);
  mesh.setMesh(packet);
  mesh.setView({ eye: [0, 9, 0], target: [0, 20, 0], up: [0, 0, 1], fov: 40 });
  mesh.setLook({ exposure: 1.5, curve: "agx" });
  return lights.map((color) => (mesh.relight({ color }), meshBrightness(mesh)));
}"""


@pytest.mark.long
def test_brightness_of_a_preview_is_that_of_its_light(farm: Farm, watched: Watched) -> None:
    page = watched.page
    page.goto(farm.url)
    lights = [[0.5, 0.5, 0.5], [0.3, 0.1, 0.02], [40, 20, 30], [0.004, 0.002, 0.001]]
    for color, found in zip(lights, page.evaluate(MEASURE, [CUBE, lights]), strict=True):
        assert [found[name] for name in ("white", "bright", "high")] == pytest.approx([max(color)] * 3, rel=0.05)
        assert found["key"] == pytest.approx(float(np.dot(color, [0.2126, 0.7152, 0.0722])), rel=0.05)
    assert watched.errors == []
