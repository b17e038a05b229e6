"""Writes a .blend and an Alembic file with hair: curves, and particles with children on a ball that has been moved.

Run by a Python that has bpy. Writes hair.blend, hair.abc and told.json: points of Blender's particle hair, as rendered.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import numpy as np

STRANDS, POINTS, PARENTS, CHILDREN = 20, 4, 30, 5


def main(folder: Path) -> None:
    """Writes the files into the folder."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    hair = bpy.data.materials.new("hair")
    hair.use_nodes = True
    tree = hair.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeBsdfHairPrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.model, shader.parametrization = "CHIANG", "COLOR"
    shader.inputs["Color"].default_value, shader.inputs["Roughness"].default_value = (0.5, 0.25, 0.125, 1.0), 0.25
    tree.links.new(shader.outputs[0], output.inputs[0])

    data = bpy.data.hair_curves.new("strands")
    data.add_curves([POINTS] * STRANDS)
    at = [(0.1 * k, 0.2 * i, -2 + 0.3 * i) for k in range(STRANDS) for i in range(POINTS)]
    data.points.foreach_set("position", np.array(at, np.float32).ravel())
    data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", np.full(len(at), 0.01, np.float32))
    data.materials.append(hair)
    strands = bpy.data.objects.new("strands", data)
    scene.collection.objects.link(strands)
    strands.select_set(True)
    bpy.ops.wm.alembic_export(filepath=str(folder / "hair.abc"), start=1, end=1, as_background_job=False)

    shown = bpy.data.collections.new("instanced")  # of a second object with the same hair, which is in no other collection
    shown.objects.link(bpy.data.objects.new("lock", data))
    carrier = bpy.data.objects.new("carrier", None)
    carrier.instance_type, carrier.instance_collection, carrier.location = "COLLECTION", shown, (0, 0, 5)
    scene.collection.objects.link(carrier)

    bpy.ops.mesh.primitive_uv_sphere_add(radius=1, location=(0.5, 2, 0), rotation=(0.3, 0, 0))
    ball = bpy.context.object
    for material in (bpy.data.materials.new("skin"), hair):
        ball.data.materials.append(material)
    ball.modifiers.new("fur", "PARTICLE_SYSTEM")
    settings = ball.particle_systems[0].settings
    settings.type, settings.count, settings.hair_length, settings.material = "HAIR", PARENTS, 0.5, 2
    settings.child_type, settings.child_percent, settings.rendered_child_count = "INTERPOLATED", 1, CHILDREN
    settings.render_step, settings.display_step = 3, 3
    settings.radius_scale, settings.root_radius, settings.tip_radius = 0.02, 1.0, 0.5
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "hair.blend"))
    settings.child_percent = CHILDREN
    evaluated = ball.evaluated_get(bpy.context.evaluated_depsgraph_get())
    system = evaluated.particle_systems[0]
    numbers = range(PARENTS, PARENTS * (1 + CHILDREN))
    told = [[list(system.co_hair(evaluated, particle_no=k, step=s)) for s in range(9)] for k in numbers]
    (folder / "told.json").write_text(json.dumps(told))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
