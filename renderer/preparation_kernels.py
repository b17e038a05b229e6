"""Compiles the kernels that prepare scenes: first those that every scene needs, so that rendering can begin early."""

from __future__ import annotations

import functools

import numpy as np

from renderer.bvh.top import LEAST_PART
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Material, Mesh, SceneDescription
from renderer.scene.geometry import MIN_BATCH_INSTANCES
from renderer.scene.readers.gltf.deform import Bones, skinned
from renderer.scene.readers.obj_lines import parse
from renderer.scene.readers.threemf_rows import cut_out

__all__ = ["is_prepared", "prepare", "prepare_first"]


_CORNERS = np.random.default_rng(0).random((6 * LEAST_PART, 3), np.float32)


def _mesh(triangles: int) -> Mesh:
    corners = _CORNERS[: 3 * triangles]
    return Mesh("soup", corners, np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3), corners)


@functools.cache
def prepare_first() -> None:
    """Compiles or loads the kernels for a static scene of a few triangles."""
    for count in (1, MIN_BATCH_INSTANCES):  # placed alone, and in a batch
        meshes, instances = [_mesh(1)] * count, [Instance(number) for number in range(count)]
        compile_scene(SceneDescription(meshes=meshes, instances=instances, materials=[Material()], environment=Environment()))


@functools.cache
def prepare() -> None:
    """Compiles or loads all kernels that prepare scenes: also those of OBJ and 3MF files, large meshes, instances and motion."""
    prepare_first()
    parse(b"v 0 0 0\n", "one-vertex.obj")
    cut_out(b'<vertices><vertex x="0" y="0" z="0" /></vertices>')
    small = _mesh(1)
    skinned(small, Bones(np.zeros((3, 4), np.int64), np.zeros((3, 4), np.float32)), np.eye(4)[None])
    meshes, instances = [_mesh(2 * LEAST_PART), small], [Instance(0), Instance(1, moves=True)]
    compile_scene(SceneDescription(meshes=meshes, instances=instances, materials=[Material()], environment=Environment()))


def is_prepared() -> bool:
    """Returns True if `prepare_first` has run in this process."""
    return prepare_first.cache_info().currsize > 0
