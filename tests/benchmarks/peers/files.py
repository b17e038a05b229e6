"""Generated GLB files: one with textured objects, and ones with a given number of triangles."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from renderer.scene.description import Mesh
from tests.benchmarks.peers.meshes import checks, displaced_sphere, torus
from tests.peers.glb import Glb
from tests.renderer.builders import square

__all__ = ["large_file", "textured_objects"]

_TILT = 18.0


def textured_objects(path: Path, triangles: int, texture: int) -> Path:
    """Writes a GLB file with a camera, and with rings and bumpy balls on the ground.

    The objects are textured, and rough, glossy or metallic. texture: width of a texture in texels.
    """
    glb = Glb()
    looks = [(0.0, 0.9), (0.0, 0.4), (1.0, 0.35), (0.0, 0.2)]
    materials = []
    for i, (metallic, roughness) in enumerate(looks):
        picture = glb.add_texture(checks(texture, seed=i).pixels[..., :3])
        base = {"baseColorTexture": {"index": picture}, "metallicFactor": metallic, "roughnessFactor": roughness}
        materials.append(glb.add("materials", {"pbrMetallicRoughness": base}))
    floor = square((0, -0.75, 0), (9, 0, 0), (0, 0, -9), 0)
    floor.uvs = np.array([(0, 4), (4, 4), (4, 0), (0, 0)], np.float32)
    floor.normals = np.tile(np.array([0, 1, 0], np.float32), (4, 1))
    glb.add_node(mesh=_add(glb, floor, materials[0]))
    shapes = [torus(triangles), displaced_sphere(triangles)]
    meshes = [_add(glb, shapes[i % 2], material) for i, material in enumerate(materials)]
    for i in range(8):
        place = [2.3 * (i % 4) - 3.45, 0.25, 1.2 - 2.6 * (i // 4)]
        glb.add_node(mesh=meshes[(i + i // 4) % len(meshes)], translation=place, scale=[0.9, 0.9, 0.9])
    lens = {"yfov": math.radians(40), "znear": 0.01, "zfar": 100.0}
    eye = glb.add("cameras", {"type": "perspective", "perspective": lens})
    half = math.radians(-_TILT) / 2
    glb.add_node(camera=eye, translation=[0, 2.9, 8.2], rotation=[math.sin(half), 0, 0, math.cos(half)])
    return glb.save(path)


def large_file(path: Path, triangles: int) -> Path:
    """Writes a GLB file of a single mesh with that many triangles, with normals and UVs; returns its path."""
    glb = Glb()
    gray = glb.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0.7, 0.7, 0.7, 1], "metallicFactor": 0}})
    glb.add_node(mesh=_add(glb, displaced_sphere(triangles), gray))
    return glb.save(path)


def _add(glb: Glb, mesh: Mesh, material: int) -> int:
    assert mesh.normals is not None and mesh.uvs is not None
    attributes = {"POSITION": mesh.positions, "NORMAL": mesh.normals, "TEXCOORD_0": mesh.uvs}
    return glb.add_mesh(attributes, mesh.triangles, material)
