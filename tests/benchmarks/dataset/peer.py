"""Runs BlenderProc on a scene of ours: finds or makes its environment, and hands it meshes and cameras."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import farm
import rayfarm
from rayfarm import Cameras
from renderer.image.read import read as read_image
from renderer.scene.load import read
from tests.benchmarks.peers.surroundings import MissingPeerError

__all__ = ["Comparison", "python_with_blenderproc", "rendered_by_blenderproc"]

SCRIPT = Path(__file__).with_name("blenderproc_views.py")
REFERENCE_SPP = 128


@dataclass(frozen=True)
class Comparison:
    """BlenderProc's results. seconds: for all views; annotation_s: of these, for instances and flow. error: relative RMSE."""

    version: str
    blender: str
    views: int
    threads: int
    spp: int
    seconds: float
    annotation_s: float
    parts: str
    error: float
    our_error: float
    reference_spp: int = REFERENCE_SPP


def python_with_blenderproc() -> Path:
    """Returns a Python with bpy and blenderproc: $RAYFARM_BLENDERPROC_PYTHON, or that of .venv-blenderproc, made if missing."""
    named = os.environ.get("RAYFARM_BLENDERPROC_PYTHON")
    if named:
        return Path(named)
    try:
        return Path(farm.install_blenderproc())
    except (SystemExit, OSError, subprocess.CalledProcessError) as error:
        raise MissingPeerError("BlenderProc's environment cannot be made; see above") from error


def rendered_by_blenderproc(
    scene: Path, poses: Any, folder: Path, fov: float, max_depth: int, options: argparse.Namespace
) -> Comparison:
    """Renders views of a scene with BlenderProc. poses: (N, 4, 4), from camera to world space, in OpenGL's convention.

    fov: in degrees. max_depth: segments of a path. options: size, spp and slots, which is the number of threads. Raises
    MissingPeerError.
    """
    python = python_with_blenderproc()
    with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as name:
        job = {"meshes": _meshes(scene), "poses": poses.tolist(), "size": options.size, "fov": fov, "spp": options.spp}
        job |= {"max_depth": max_depth, "threads": options.slots, "folder": name, "reference_spp": REFERENCE_SPP}
        (Path(name) / "job.json").write_text(json.dumps(job))
        done = subprocess.run([python, SCRIPT, Path(name) / "job.json"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise MissingPeerError(f"BlenderProc failed: {done.stderr[-3000:]}")
    found = json.loads(done.stdout.splitlines()[-1])
    parts: dict[str, float] = found["parts"]
    said = ", ".join(f"{part} {1000 * seconds / len(poses):.0f} ms a view" for part, seconds in parts.items())
    return Comparison(
        *(found["version"], found["blender"], len(poses), options.slots, options.spp, found["seconds"]),
        *(parts["instances"] + parts["flow"], said, found["error"], _our_error(scene, poses, folder, fov, max_depth, options)),
    )


def _meshes(scene: Path) -> list[dict[str, Any]]:
    """Returns the instances of a scene of Lambertian materials as meshes in world space."""
    description = read(scene.parent, scene.name)
    found = []
    for instance in description.instances:
        mesh = description.meshes[instance.mesh]
        points = np.c_[mesh.positions, np.ones(len(mesh.positions))] @ instance.transform.T
        material = description.materials[mesh.material if instance.material is None else instance.material]
        of_mesh = {"name": instance.name, "vertices": points[:, :3].tolist(), "triangles": mesh.triangles.tolist()}
        found.append(of_mesh | {"color": list(material.base_color)[:3], "emission": list(material.emission)[:3]})
    return found


def _our_error(scene: Path, poses: Any, folder: Path, fov: float, max_depth: int, options: argparse.Namespace) -> float:
    """Returns the relative RMSE of the first view's linear pixels against more samples of another seed, as of BlenderProc."""
    pictures = []
    for spp, seed in ((options.spp, 1), (REFERENCE_SPP, 2)):
        place = folder / f"error-{spp}-{max_depth}"
        size = {"width": options.size, "height": options.size, "spp": spp, "seed": seed, "max_depth": max_depth}
        made = rayfarm.dataset(
            scene,
            Cameras(poses[:1]),
            folder=place,
            fov=fov,
            outputs=["color"],
            picture_format="exr",
            threads=options.slots,
            **size,
        )
        path = place / made.views[0]["files"]["color"]["path"]
        pictures.append(np.asarray(read_image(path.read_bytes(), path.name), np.float64)[..., :3])
    one, reference = pictures
    return float(np.sqrt(((one - reference) ** 2).mean()) / reference.mean())
