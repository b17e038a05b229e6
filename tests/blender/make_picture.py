"""Renders docs/pictures/blender.jpg, a scene built here, with the add-on on a farm. Run by a Python that has bpy.

python make_picture.py FOLDER URL, where FOLDER has the add-on's package and receives the picture.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import bpy
from blender_scenes import add, background, empty, lamp, leaves, look, principled

FOLDER, URL = Path(sys.argv[1]), sys.argv[2]


def scene() -> bpy.types.Scene:
    """Returns monkey heads of several materials, instanced cones, and a camera with depth of field."""
    made = empty()
    background(made).inputs["Color"].default_value = (0.35, 0.42, 0.5, 1)
    background(made).inputs["Strength"].default_value = 0.5
    add("plane", principled("floor", Base_Color=(0.42, 0.38, 0.34, 1), Roughness=0.6), size=40)
    heads = (
        ("paint", (-1.7, -0.4), {"Base_Color": (0.55, 0.03, 0.03, 1), "Roughness": 0.4, "Coat_Weight": 1.0}),
        ("gold", (0.0, 0.3), {"Base_Color": (0.95, 0.62, 0.22, 1), "Metallic": 1.0, "Roughness": 0.22}),
        ("velvet", (1.7, 1.0), {"Base_Color": (0.05, 0.06, 0.3, 1), "Roughness": 0.9, "Sheen_Weight": 1.0}),
    )
    for name, (x, y), values in heads:
        ape = add("monkey", principled(name, **values), size=1.5, location=(x, y, 0.74), rotation=(-0.62, 0, 0.45))
        ape.modifiers.new("smooth", "SUBSURF").render_levels = 3
    glass = principled("glass", Base_Color=(0.9, 0.97, 0.95, 1), Roughness=0.0, Transmission_Weight=1.0)
    add("uv_sphere", glass, location=(0.75, -1.25, 0.35), radius=0.35, segments=64, ring_count=32)
    leaves(made)
    lamp("AREA", 700.0, (3, -4, 5), size=3.0, color=(1, 0.9, 0.78))
    lamp("AREA", 250.0, (-5, 2, 4), size=2.0, color=(0.7, 0.82, 1))
    made.camera.location = (3.2, -6.2, 2.5)
    look(made.camera, (0, 0.2, 0.55))
    lens = made.camera.data
    lens.lens, lens.dof.use_dof, lens.dof.aperture_fstop, lens.dof.focus_distance = 50, True, 0.25, 6.6
    made.render.resolution_x, made.render.resolution_y = 800, 450
    made.render.engine = "RAYFARM"
    made.rayfarm.samples, made.rayfarm.depth, made.rayfarm.denoise = 96, 10, True
    made.render.image_settings.file_format, made.render.image_settings.quality = "JPEG", 90
    made.render.filepath = str(FOLDER / "blender.jpg")
    return made


if __name__ == "__main__":
    sys.path.insert(0, str(FOLDER))
    os.environ["RAYFARM_SERVER"] = URL
    import rayfarm_addon

    rayfarm_addon.register()
    scene()
    bpy.ops.render.render(write_still=True)
