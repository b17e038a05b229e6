"""The kernels that prepare scenes."""

from __future__ import annotations

import functools

import numpy as np

from renderer.bvh.top import LEAST_PART
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Material, Mesh, SceneDescription
from renderer.scene.readers.gltf.deform import Bones, skinned

__all__ = ["is_prepared", "prepare", "prepare_most"]


@functools.cache
def prepare() -> None:
    """Compiles the kernels that prepare scenes, or loads them: those for a mesh that is large enough to need every one, and for
    one that moves."""
    large, small = _large(), _small()
    skinned(small, Bones(np.zeros((3, 4), np.int64), np.zeros((3, 4), np.float32)), np.eye(4)[None])
    _compile([large, small], [Instance(0), Instance(1, moves=True)])


def prepare_most() -> None:
    """Two thirds of them: those for a small mesh that stands still."""
    _compile([_small()], [Instance(0)])


def is_prepared() -> bool:
    """Whether `prepare` was here."""
    return prepare.cache_info().currsize > 0


def _compile(meshes: list[Mesh], instances: list[Instance]) -> None:
    compile_scene(SceneDescription(meshes=meshes, instances=instances, materials=[Material()], environment=Environment()))


def _large() -> Mesh:
    count = 2 * LEAST_PART
    corner = np.random.default_rng(0).random((3 * count, 3), np.float32)
    return Mesh("soup", corner, np.arange(3 * count, dtype=np.int32).reshape(-1, 3), corner)


def _small() -> Mesh:
    corner = np.random.default_rng(0).random((3, 3), np.float32)
    return Mesh("corner", corner, np.arange(3, dtype=np.int32).reshape(1, 3), corner)
