"""The kernels that prepare scenes, compiled beside the one that renders them: a machine has two cores at least.

Numba compiles one function at a time in a process, so this is one of its own. What it compiles lies in the kernels' folder, from
where the other loads it.
"""

from __future__ import annotations

import contextlib
import functools
import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np

from renderer.bvh.top import LEAST_PART
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Material, Mesh, SceneDescription
from renderer.scene.readers.gltf.deform import Bones, skinned
from renderer.sources import ROOT
from renderer.threads import cores

__all__ = ["prepare", "preparing_beside"]


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


@contextlib.contextmanager
def preparing_beside(is_cold: bool, edition: str | None = None) -> Iterator[None]:
    """Where they have to be compiled, another process does so meanwhile. If it fails, `prepare` does it again, and says why.

    edition: of the kernel for pictures, a part of which is compiled first (renderer/beside.py); None: of none.
    """
    if not is_cold or cores() == 1 or prepare.cache_info().currsize:
        yield
        return
    path = os.pathsep.join([str(ROOT.parent), os.environ.get("PYTHONPATH", "")])
    other = subprocess.Popen(
        [sys.executable, "-m", "renderer.beside", *([edition] if edition else [])],
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
        other.wait()
    finally:
        other.kill()
        other.wait()
