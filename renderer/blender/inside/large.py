"""Bypasses the glTF exporter for fibres of hair, and for large meshes, since it takes several seconds for a million triangles.

The exporter gets a stand-in for each large mesh, with one triangle per material, and writes it with its materials; afterwards
the real geometry is written into the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .glb import Glb
from .principled_materials import modules_of

__all__ = ["Taken", "replace_by_stand_ins", "restore_large_meshes", "stand_in"]

MIN_FACES = 20_000  # faces
COLORED = {
    "VERTEX_COLOR",
    "ATTRIBUTE",
}  # nodes for which the exporter writes attributes that `restore_large_meshes` does not restore
FLOAT, UINT = 5126, 5125
MAX_GROUP_DEPTH = 16

Taken = dict[str, Any]  # rayfarm_addon's meshes, by the names of their stand-ins


def replace_by_stand_ins(bpy: Any, objects: list[Any], addon: Path | None) -> Taken:
    """Replaces large, undeformed meshes by stand-ins; returns stand-in name -> the real mesh, for `restore_large_meshes`.

    addon: the add-on's folder, or None, in which case nothing is replaced.
    """
    if addon is None:
        return {}
    extract = modules_of(addon).meshes.extract
    made: dict[Any, Any] = {}
    taken: Taken = {}
    for thing in objects:
        if thing.type != "MESH" or thing.library is not None or not _is_plain(thing):
            continue
        mesh = thing.data
        if mesh not in made:
            found = extract(mesh, mesh.name, all_uvs=True)
            if found is None:
                continue
            made[mesh] = _stand_in(bpy, mesh, [slot for slot, _ in found[0].parts])
            taken[made[mesh].name] = found[0]
        thing.data = made[mesh]
    return taken


def restore_large_meshes(path: Path, stand_ins: Taken) -> None:
    """Replaces the stand-ins in a GLB file by the real meshes. stand_ins: from `replace_by_stand_ins`."""
    if not stand_ins:
        return
    glb = Glb(path)
    for mesh in glb.document.get("meshes", []):
        if (meant := stand_ins.get(mesh.get("name", ""))) is not None:
            _add_mesh(glb, mesh["primitives"], meant)
    glb.write(path)


def _is_plain(thing: Any) -> bool:
    mesh = thing.data
    if len(mesh.polygons) < MIN_FACES or mesh.shape_keys is not None or any(each.type == "ARMATURE" for each in thing.modifiers):
        return False
    materials = [slot.material for slot in thing.material_slots]
    return not mesh.color_attributes or not (not any(materials) or any(_is_colored(each) for each in materials if each))


def _is_colored(material: Any) -> bool:
    return material.use_nodes and material.node_tree is not None and _has_colors(material.node_tree, MAX_GROUP_DEPTH)


def _has_colors(tree: Any, depth: int) -> bool:
    return depth == 0 or any(
        node.type in COLORED or (node.type == "GROUP" and node.node_tree is not None and _has_colors(node.node_tree, depth - 1))
        for node in tree.nodes
    )


def _stand_in(bpy: Any, mesh: Any, slots: list[int]) -> Any:
    """Returns a stand-in for a mesh: one triangle for each used material slot, and UV sets with the mesh's names."""
    made = bpy.data.meshes.new(mesh.name)
    corners = [(x, y, float(i)) for i in range(len(slots)) for x, y in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
    made.from_pydata(corners, [], [(3 * i, 3 * i + 1, 3 * i + 2) for i in range(len(slots))])
    for material in mesh.materials:
        made.materials.append(material)
    for polygon, slot in zip(made.polygons, slots, strict=True):
        polygon.material_index = slot
        polygon.use_smooth = True
    for layer in mesh.uv_layers:
        made.uv_layers.new(name=layer.name)
    for layer in mesh.uv_layers:
        made.uv_layers[layer.name].active_render = layer.active_render
    if mesh.uv_layers.active is not None:
        made.uv_layers.active_index = mesh.uv_layers.active_index
    made.update()
    return made


def stand_in(bpy: Any, name: str, materials: list[Any]) -> Any:
    """Returns a new mesh of one triangle with these materials, to stand in for a mesh without UVs."""
    made = bpy.data.meshes.new(name)
    made.from_pydata([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], [], [(0, 1, 2)])
    for material in materials:
        made.materials.append(material)
    made.polygons[0].use_smooth = True
    made.update()
    return made


def _add_mesh(glb: Glb, primitives: list[dict[str, Any]], mesh: Any) -> None:
    import numpy as np

    def to_y_up(vectors: Any) -> Any:
        return np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], axis=1)

    attributes = {"POSITION": glb.array(to_y_up(mesh.positions), "VEC3", FLOAT, is_bounded=True)}
    if mesh.normals is not None:
        attributes["NORMAL"] = glb.array(to_y_up(mesh.normals), "VEC3", FLOAT)
    attributes |= {f"TEXCOORD_{i}": glb.array(uv, "VEC2", FLOAT) for i, uv in enumerate(mesh.uvs)}
    if mesh.fibres is not None:
        along = np.column_stack([to_y_up(mesh.fibres[:, :3]), mesh.fibres[:, 3]])
        attributes["_FIBRE"] = glb.array(along, "VEC4", FLOAT)
    for primitive, (_, corners) in zip(primitives, mesh.parts, strict=True):
        primitive["attributes"] = attributes
        primitive["indices"] = glb.array(corners, "SCALAR", UINT)
