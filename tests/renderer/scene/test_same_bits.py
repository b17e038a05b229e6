"""Tests that moving geometry has the same bits for any BLAS and any NumPy code path of the processor."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.helpers import ROOT
from tests.renderer.scene.builders import Gltf, clip

LATHE = """
fps: 24
cameras: [{eye: {keys: [[0, [0, 1, 5]], [1, [4, 2, 3]]], curve: smooth}, target: [0, 0, 0], turntable: 3.7}]
shapes:
  - type: group
    transform: [{rotate: {axis: [1, 2, 3], degrees: {keys: [[0, 0], [1, 77.7]]}}}, {scale: [1.1, 0.7, 1.3]}]
    shapes:
      - {type: cube, transform: [{rotate: {axis: [0.3, 1, 0.1], degrees: 33.3}}, {translate: [0.1, 0.2, 0.3]}]}
      - {type: sphere, center: [0.7, 0.1, 0.9], radius: 0.3, transform: []}
""".replace("scale: [1.1, 0.7, 1.3]", "scale: 1.1")


def figure():
    """Returns a GLB of 200 vertices on a chain of five rotating joints, with two morph targets, normals and tangents."""
    rng = np.random.default_rng(8)
    g = Gltf()
    points, normals = rng.normal(size=(2, 200, 3)).astype(np.float32)
    tangents = np.column_stack([rng.normal(size=(200, 3)), np.ones(200)]).astype(np.float32)
    more = {"JOINTS_0": rng.integers(0, 5, (200, 4)).astype(np.uint8), "WEIGHTS_0": rng.random((200, 4), np.float32)}
    g.mesh(points, NORMAL=normals, TANGENT=tangents, **more)
    targets = [{"POSITION": g.array(rng.normal(size=(200, 3)).astype(np.float32))} for _ in range(2)]
    g.root["meshes"][0]["primitives"][0]["targets"] = targets
    g.root["nodes"][0]["skin"] = 0
    channels = [(0, "weights", [0, 1], rng.random(4), "LINEAR")]
    for k in range(5):
        below = {"children": [k + 2]} if k < 4 else {}
        g.node(top=k == 0, translation=rng.normal(size=3).tolist(), scale=(1 + rng.random(3)).tolist(), **below)
        channels.append((k + 1, "rotation", [0, 1], rng.normal(size=(2, 4)), "LINEAR"))
    bind = rng.normal(size=(5, 16)).astype(np.float32)
    bind[:, 3::4] = (0, 0, 0, 1)
    g.root["skins"] = [{"joints": [1, 2, 3, 4, 5], "inverseBindMatrices": g.array(bind)}]
    return clip(g, "all", *channels).glb()


def digest(folder):
    """Returns a digest of the meshes, transforms, spheres and cameras of two animated files, at four frames."""
    (Path(folder) / "figure.glb").write_bytes(figure())
    (Path(folder) / "shot.yaml").write_text(LATHE)
    found = hashlib.sha256()
    for name in ("figure.glb", "shot.yaml"):
        shot = Shot(Path(folder), name)
        for frame in (0, 5, 11.5, 17):
            description = shot.scene_at(Moment(frame))
            for mesh in description.meshes:
                for array in (mesh.positions, mesh.normals, mesh.tangents):
                    found.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
            for instance in description.instances:
                found.update(np.ascontiguousarray(instance.transform).tobytes())
            views = [camera.view for camera in description.cameras]
            found.update(repr(([sphere.center for sphere in description.spheres], views)).encode())
    return found.hexdigest()


@pytest.mark.parametrize("kernels", ["Prescott", pytest.param("Haswell", marks=pytest.mark.long)])
def test_geometry_has_the_same_bits_on_other_processors(tmp_path, kernels):
    """Results are equal for OpenBLAS kernels with and without FMA."""
    ours = digest(tmp_path)
    loops = " ".join(name for name in __cpu_dispatch__ if __cpu_features__[name])
    program = "import sys; from tests.renderer.scene.test_same_bits import digest; print(digest(sys.argv[1]))"
    environment = {**os.environ, "OPENBLAS_CORETYPE": kernels, "NPY_DISABLE_CPU_FEATURES": loops}
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == ours
