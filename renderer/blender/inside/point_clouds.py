"""Converts point clouds to meshes of small spheres, which the glTF exporter supports."""

from __future__ import annotations

from typing import Any

__all__ = ["MOST_POINTS", "mesh_of_points"]

MOST_POINTS = 200_000
# (greatest number of points, subdivisions of the icosphere of each point)
SUBDIVISIONS = ((2_500, 3), (25_000, 2), (MOST_POINTS, 1))


def mesh_of_points(bpy: Any, name: str, data: Any) -> Any:
    """Returns a mesh with a sphere for each point of a bpy.types.PointCloud, of at most MOST_POINTS."""
    import bmesh
    import numpy as np

    count = len(data.points)
    at, radii = np.empty(3 * count, np.float32), np.empty(count, np.float32)
    data.points.foreach_get("co", at)
    data.points.foreach_get("radius", radii)
    ball = bmesh.new()
    levels = next(levels for most, levels in SUBDIVISIONS if count <= most)
    bmesh.ops.create_icosphere(ball, subdivisions=levels, radius=1.0)
    ball.verts.index_update()
    corners = np.array([vertex.co for vertex in ball.verts], np.float32)
    faces = np.array([[vertex.index for vertex in face.verts] for face in ball.faces], np.int32)
    ball.free()
    positions = at.reshape(-1, 1, 3) + radii[:, None, None] * corners
    triangles = faces + len(corners) * np.arange(count, dtype=np.int32)[:, None, None]
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(positions.size // 3)
    mesh.vertices.foreach_set("co", positions.ravel())
    mesh.loops.add(triangles.size)
    mesh.loops.foreach_set("vertex_index", triangles.ravel())
    mesh.polygons.add(triangles.size // 3)
    mesh.polygons.foreach_set("loop_start", np.arange(0, triangles.size, 3, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(triangles.size // 3, bool))
    mesh.update(calc_edges=True)
    for material in data.materials:
        mesh.materials.append(material)
    return mesh
