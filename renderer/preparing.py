"""The kernels that prepare scenes."""

from __future__ import annotations

import functools

import numpy as np

from renderer.bvh.build import build
from renderer.bvh.top import LEAST_PART
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Material, Mesh, SceneDescription
from renderer.scene.readers.gltf.deform import Bones, skinned

__all__ = ["is_prepared", "prepare", "prepare_trees"]


@functools.cache
def prepare() -> None:
    """Compiles the kernels that prepare scenes, or loads them: those for a mesh that is large enough to need every one, and for
    one that moves."""
    count = 2 * LEAST_PART
    corner = np.random.default_rng(0).random((3 * count, 3), np.float32)
    mesh = Mesh("soup", corner, np.arange(3 * count, dtype=np.int32).reshape(-1, 3), corner)
    small = Mesh("corner", corner[:3], np.arange(3, dtype=np.int32).reshape(1, 3), corner[:3])
    skinned(small, Bones(np.zeros((3, 4), np.int64), np.zeros((3, 4), np.float32)), np.eye(4)[None])
    instances = [Instance(0), Instance(1, moves=True)]
    compile_scene(SceneDescription(meshes=[mesh, small], instances=instances, materials=[Material()], environment=Environment()))


def prepare_trees() -> None:
    """About half of them: those that build a tree over a mesh."""
    build(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32), np.zeros((0, 4), np.float32))


def is_prepared() -> bool:
    """Whether `prepare` was here."""
    return prepare.cache_info().currsize > 0
