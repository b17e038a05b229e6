"""Tasks that test_in_blender.py runs inside Blender. Run by a Python that has bpy; of our code it imports only the add-on.

    python in_blender.py FOLDER URL TASK,TASK:SCENE [TOKEN]

FOLDER contains the add-on's package, and receives the tasks' output. URL is the farm's. The last line printed is JSON: the
results of the tasks by name.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

import blender_artists
import bpy
import numpy as np
from blender_scenes import (
    add,
    background,
    blank_images,
    empty,
    lamp,
    leaves,
    look,
    principled,
    table,
)
from blender_survey import SURVEY, made
from blender_window import Engine, Region

FOLDER, URL, TASK = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
TOKEN = sys.argv[4] if len(sys.argv) > 4 else ""


def use(engine: str, scene: bpy.types.Scene, samples: int) -> None:
    """Selects a render engine, with settings that make the pictures of Cycles and of the farm comparable."""
    scene.render.engine = engine
    if engine == "RAYFARM":
        scene.rayfarm.samples, scene.rayfarm.depth, scene.rayfarm.filter = samples, 14, "box"
        return
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", samples, False, False
    cycles.pixel_filter_type = "BOX"
    cycles.filter_width = 1.0
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 12
    cycles.transparent_max_bounces = 64
    cycles.blur_glossy = cycles.sample_clamp_indirect = cycles.sample_clamp_direct = cycles.light_sampling_threshold = 0.0


def picture(name: str, scene: bpy.types.Scene, engine: str, samples: int = 256, format: str = "OPEN_EXR") -> str:
    """Renders a picture into a file of the folder; returns the file's name."""
    use(engine, scene, samples)
    scene.render.image_settings.file_format = format
    scene.render.filepath = str(FOLDER / name)
    bpy.ops.render.render(write_still=True)
    return name


def both(name: str, scene: bpy.types.Scene, samples: int = 256) -> list[str]:
    """Renders the scene to two files, with Cycles and with the farm; returns the add-on's messages about the second render."""
    from rayfarm_addon.ui import connection

    lost = blank_images()
    assert not lost, f"{name}: these pictures are blank, and nothing would be compared: {lost}"
    for engine in ("CYCLES", "RAYFARM"):
        picture(f"{name}-{engine.lower()}.exr", scene, engine, samples)
    return connection.notes()


def lamps() -> list[str]:
    """Renders a scene under each kind of light with Cycles and with the farm; returns the pictures' names."""
    kinds = {
        "sun": ("SUN", 3.0, {"angle": 0.2}),
        "point": ("POINT", 400.0, {"shadow_soft_size": 0.3, "color": (1, 0.8, 0.6)}),
        "spot": ("SPOT", 900.0, {"spot_size": 0.9, "spot_blend": 0.6, "shadow_soft_size": 0.1}),
        "area": ("AREA", 300.0, {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.7}),
        "disk": ("AREA", 300.0, {"shape": "DISK", "size": 1.5}),
    }
    for name, (kind, energy, values) in kinds.items():
        scene = empty()
        table(scene)
        background(scene).inputs["Strength"].default_value = 0.05
        lamp(kind, energy, (1.5, -2.5, 4), **values)
        both(f"lamp-{name}", scene)
    return [f"lamp-{name}" for name in kinds]


def hidden() -> list[str]:
    """Renders two scenes with a mirror, in one of which the lamps are hidden from the camera; returns the pictures' names.

    The sun has size 0, since it would be visible in Cycles' mirrors otherwise.
    """
    for name, is_seen in (("hidden", False), ("shown", True)):
        scene = empty()
        table(scene)
        mirror = principled("mirror", Base_Color=(0.9, 0.9, 0.9, 1), Metallic=1, Roughness=0.05)
        add("uv_sphere", mirror, location=(0.3, -1.8, 0.5), segments=64, ring_count=48)
        background(scene).inputs["Strength"].default_value = 0.3
        lamp("SUN", 1.5, (1.0, -1.0, 6), angle=0.0)
        lamp("AREA", 60.0, (0.6, -0.8, 2.2), size=1.6).visible_camera = is_seen
        lamp("POINT", 60.0, (-1.2, -1.2, 1.4), shadow_soft_size=0.4).visible_camera = is_seen
        both(f"lamp-{name}", scene)
    return ["lamp-hidden", "lamp-shown"]


def survey(*names: str) -> dict[str, list[str]]:
    """Renders the scenes of SURVEY with Cycles and with the farm, and saves each as a .blend file.

    Returns the add-on's messages by scene. names: of the scenes; default: all.
    """
    said = {}
    for name in names or SURVEY:
        scene = made(name)
        use("CYCLES", scene, 256)
        bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / f"{name}.blend"), copy=True, compress=False)
        said[name] = both(name, scene)
    return said


def indices() -> dict:
    """Renders the object and material index passes of the scene "hidden" with Cycles and with the farm."""
    scene = made("hidden")
    layer = bpy.context.view_layer
    layer.use_pass_object_index = layer.use_pass_material_index = True
    for engine in ("CYCLES", "RAYFARM"):
        picture(f"indices-{engine.lower()}.exr", scene, engine, 16, "OPEN_EXR_MULTILAYER")
    return {}


def artists() -> list[str]:
    """Renders four scenes of blender_artists.py with Cycles and with the farm; returns the pictures' names."""
    names = ("shaders", "suns", "rays", "bumps")
    for name in names:
        both(f"artists-{name}", getattr(blender_artists, name)())
    return [f"artists-{name}" for name in names]


def surroundings() -> list[str]:
    """Renders the scene `surroundings` of blender_artists.py with Cycles and with the farm; returns the picture's name."""
    both("surroundings", blender_artists.surroundings())
    return ["surroundings"]


def cameras() -> list[str]:
    """Renders a scene with many instances through four cameras, with Cycles and with the farm; returns the pictures' names.

    The cameras have depth of field, a shifted lens, a border, and an orthographic projection.
    """
    names = []
    for name in ("field", "shift", "border", "flat"):
        scene = empty()
        table(scene)
        leaves(scene)
        lamp("AREA", 400.0, (2, -3, 5), size=2.0)
        lens = scene.camera.data
        if name == "field":
            lens.dof.use_dof, lens.dof.aperture_fstop, lens.dof.focus_object = True, 0.1, bpy.data.objects["Torus"]
        elif name == "shift":
            lens.shift_x, lens.shift_y = 0.35, -0.2
        elif name == "border":
            scene.render.use_border, scene.render.use_crop_to_border = True, True
            scene.render.border_min_x, scene.render.border_max_x = 0.25, 0.75
            scene.render.border_min_y, scene.render.border_max_y = 0.0, 0.5
        else:
            lens.type, lens.ortho_scale = "ORTHO", 5.0
        both(f"camera-{name}", scene)
        names.append(f"camera-{name}")
    return names


def moving() -> list[str]:
    """Renders the scene `moving` of blender_artists.py with motion blur at two shutter positions; returns the pictures' names."""
    scene = blender_artists.moving()
    names = []
    for at in ("CENTER", "END"):
        scene.frame_set(2)
        scene.render.motion_blur_position = at
        both(f"moving-{at.lower()}", scene)
        names.append(f"moving-{at.lower()}")
    scene.frame_set(2)
    return names


def passes() -> dict:
    """Renders all passes with the farm into a multilayer file."""
    scene = empty()
    table(scene)
    lamp("AREA", 400.0, (2, -3, 5), size=2.0)
    layer = bpy.context.view_layer
    for name in ("z", "position", "normal", "object_index", "material_index"):
        setattr(layer, f"use_pass_{name}", True)
    bpy.data.materials["gold"].pass_index = 42
    for engine in ("CYCLES", "RAYFARM"):
        if engine == "RAYFARM":
            scene.rayfarm.albedo = True
        picture(f"passes-{engine.lower()}.exr", scene, engine, 16, "OPEN_EXR_MULTILAYER")
    return {"eye": list(scene.camera.matrix_world.translation)}


def sent_bytes() -> int:
    """Returns the number of bytes of the last upload to the farm."""
    from rayfarm_addon.ui import connection

    return connection.connect(URL, TOKEN, "").uploads.sent_bytes


def changes() -> dict:
    """Renders one scene five times, and returns the bytes that each render sends to the farm.

    Between the renders: no change, the camera moves, a small object moves, and a vertex of a large mesh moves.
    """
    scene = empty()
    table(scene)
    for i in range(3):
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6, location=(i, 2, 1))
        bpy.context.object.name = f"large {i}"
    sent = {}
    scene.render.resolution_x = scene.render.resolution_y = 16
    use("RAYFARM", scene, 1)
    scene.render.filepath = str(FOLDER / "changes")

    def render(name: str) -> None:
        bpy.ops.render.render(write_still=False)
        sent[name] = sent_bytes()

    render("all")
    render("nothing")
    scene.camera.location[0] += 0.5
    render("camera")
    bpy.data.objects["Torus"].location[2] += 0.2
    render("moved")
    bpy.data.objects["large 1"].data.vertices[5].co *= 1.3
    render("one")
    return sent


def animation() -> list[str]:
    """Renders three frames as an animation."""
    scene = empty()
    table(scene)
    lamp("AREA", 400.0, (2, -3, 5), size=2.0)
    cube = bpy.data.objects["Cube"]
    for frame, x in ((1, 1.1), (3, -0.9)):
        cube.location[0] = x
        cube.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end = 1, 3
    use("RAYFARM", scene, 16)
    scene.render.filepath = str(FOLDER / "shot.####.exr")
    bpy.ops.render.render(animation=True)
    return [f"shot.{frame:04}.exr" for frame in (1, 2, 3)]


def refused() -> dict:
    """Returns the error messages that Blender shows for an unreachable farm and for a wrong token."""
    scene = empty()
    table(scene)
    use("RAYFARM", scene, 1)
    try:
        bpy.ops.render.render()
        said = ""
    except RuntimeError as error:
        said = str(error)
    try:
        bpy.ops.rayfarm.test_connection()
        tested = ""
    except RuntimeError as error:
        tested = str(error)
    scene.render.resolution_x = 40_000
    try:
        bpy.ops.render.render()
        large = ""
    except RuntimeError as error:
        large = str(error)
    return {"said": said, "tested": tested, "large": large}


def cancelled() -> dict:
    """Starts a render, and cancels it through the engine's `test_break` while tiles arrive."""
    scene = empty()
    table(scene)
    use("RAYFARM", scene, 1 << 16)
    from rayfarm_addon.ui import engine

    whole, shown = engine.RayfarmEngine._copy_tile, []

    def counted(self, *args):
        shown.append(args)
        return whole(self, *args)

    # Without a window there is no Esc key: `test_break` returns True once a tile has arrived.
    engine.RayfarmEngine._copy_tile = counted
    engine.RayfarmEngine._is_cancelled = lambda self: bool(shown)
    bpy.ops.render.render()
    return {"tiles": len(shown)}


def viewport() -> dict:
    """Runs a viewport render except for drawing, which needs a window; returns the data that it reads, sends and receives."""
    from rayfarm_addon.ui.viewport import Viewport

    scene = empty()
    table(scene)
    for i in range(3):
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6, location=(i, 9, 1))
    lamp("AREA", 400.0, (2, -3, 5), size=2.0)
    use("RAYFARM", scene, 256)
    scene.rayfarm.view_samples = 256
    region = Region(scene)
    view = Viewport(Engine(), URL, TOKEN, "", "test")
    longest, sent = [0.0], []
    bpy.app.handlers.depsgraph_update_post.append(lambda scene, depsgraph: view.update(depsgraph))
    view.update(bpy.context.evaluated_depsgraph_get())

    def seen() -> np.ndarray:
        """Returns the picture once it is complete."""
        until = time.monotonic() + 300
        depsgraph = bpy.context.evaluated_depsgraph_get()
        while time.monotonic() < until:
            begun = time.monotonic()
            view.read(depsgraph)
            view.send_view(region, depsgraph)
            longest[0] = max(longest[0], time.monotonic() - begun)
            rests = view._reading is None and not view._waits and view._watching.is_up_to_date
            shown, text = view._watching.picture_and_status  # read after checking that the picture is of the newest scene
            if rests and shown is not None and shown.id == view._watching.number and text.endswith("done"):
                sent.append(sent_bytes())
                return shown.rgb
            time.sleep(0.02)
        raise SystemExit(f"no picture came: {view._watching.picture_and_status[1]}")

    first = seen()
    scene.camera.location[0] += 0.7
    look(scene.camera)
    bpy.context.view_layer.update()
    turned = seen()
    bpy.data.materials["red"].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.1, 0.1, 0.9, 1)
    bpy.context.view_layer.update()
    painted = seen()
    bpy.data.objects["Cube"].location[2] += 1
    bpy.context.view_layer.update()
    lifted = seen()
    view.close()
    assert not bpy.app.timers.is_registered(view._ticking), "Blender would call it, or free it when Python has ended"
    bpy.app.handlers.depsgraph_update_post.clear()
    picture("viewport.exr", scene, "RAYFARM")
    np.savez(FOLDER / "viewport.npz", first=first, turned=turned, painted=painted, lifted=lifted)
    return {"sent": sent, "longest": longest[0]}


def large() -> dict:
    """Exports a mesh of a million triangles with normals and UVs, without sending it.

    Returns the triangle count, the processor seconds to read Blender's data and to write the files, and the files' bytes.
    """
    from rayfarm_addon.scene.files import digest_of, scene_files
    from rayfarm_addon.scene.gather import export_scene

    scene = empty()
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=1000, y_subdivisions=500)
    bpy.ops.object.shade_smooth()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    begun = time.process_time()
    *_, found = export_scene(depsgraph, {})
    read = time.process_time()
    files = scene_files(found.scene)
    for content in files.values():
        digest_of(content)
    triangles = sum(len(corners) // 3 for mesh in found.scene.meshes.values() for _, corners in mesh.parts)
    ends = time.process_time()
    size = sum(len(content) for content in files.values())
    return {"triangles": triangles, "read": read - begun, "written": ends - read, "bytes": size, "engine": scene.render.engine}


TASKS = {
    each.__name__: each
    for each in (
        lamps,
        hidden,
        survey,
        indices,
        artists,
        surroundings,
        cameras,
        moving,
        passes,
        changes,
        animation,
        refused,
        cancelled,
        viewport,
        large,
    )
}


def main() -> None:
    sys.path.insert(0, str(FOLDER))
    os.environ["RAYFARM_SERVER"], os.environ["RAYFARM_API_TOKEN"] = URL, TOKEN
    import rayfarm_addon

    rayfarm_addon.register()
    tasks = [task.split(":") for task in TASK.split(",")]
    print(json.dumps({name: TASKS[name](*rest) for name, *rest in tasks}), flush=True)
    rayfarm_addon.unregister()


if __name__ == "__main__":
    main()
