"""The scenes of hard light as our YAML files with PLY meshes, and as cases for Rayfarm and Mitsuba, which are made from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from renderer.scene.description import Mesh
from renderer.scene.load import read
from renderer.settings import RenderSettings
from tests.benchmarks.hard.scenes import DEPTH, SIZE, HardScene, Part, Surface
from tests.benchmarks.peers.scenes import Case
from tests.peers.mitsuba_scene import write_ply

__all__ = ["HardCase", "case_of", "write_yaml"]


@dataclass
class HardCase(Case):
    """A scene of hard light, whose paths have DEPTH segments."""

    def settings(self, pixels: int, **more: Any) -> RenderSettings:
        """Returns the render settings of a square picture. pixels: its width and height. more: further settings."""
        return replace(super().settings(pixels, **more), max_depth=DEPTH)


def case_of(scene: HardScene, folder: Path) -> HardCase:
    """Writes the scene's files into a folder, and returns what is read of them."""
    path = write_yaml(scene, folder)
    description = read(folder, path.name)
    return HardCase(scene.name, description, description.cameras[0].view)


def write_yaml(scene: HardScene, folder: Path) -> Path:
    """Writes the scene as YAML, with a PLY file for each smooth mesh; returns the path of the YAML file."""
    made: dict[str, Any] = {
        "name": scene.title,
        "settings": {"width": SIZE, "height": SIZE, "max_depth": DEPTH, "filter": "box"},
        "cameras": [{"name": "main", "eye": list(scene.eye), "target": list(scene.target), "fov": scene.fov}],
    }
    if scene.sky is not None:
        made["environment"] = {"color": list(scene.sky)}
    if scene.sun is not None:
        direction, intensity = list(scene.sun.direction), list(scene.sun.irradiance)
        made["lights"] = [{"type": "directional", "direction": direction, "intensity": intensity}]
    made["materials"] = {name: _material(surface) for name, surface in scene.surfaces.items()}
    made["shapes"] = [_shape(part, f"{scene.name}-{part.name}.ply", folder) for part in scene.parts]
    path = folder / f"{scene.name}.yaml"
    path.write_text(yaml.safe_dump(made, sort_keys=False, default_flow_style=None, width=1000))
    return path


def _material(surface: Surface) -> dict[str, Any]:
    if surface.kind == "glass":
        return {"kind": "glass", "color": 1, "ior": surface.ior}
    if surface.kind == "light":
        return {"kind": "diffuse", "color": 0, "emission": list(surface.color)}
    return {"kind": "diffuse", "color": list(surface.color)}


def _shape(part: Part, file: str, folder: Path) -> dict[str, Any]:
    named = {"name": part.name, "material": part.surface}
    shape = part.shape
    if shape.normals is None:
        return {"type": "faces", **named, "positions": shape.positions.tolist(), "faces": shape.triangles.tolist()}
    mesh = Mesh(part.name, shape.positions.astype(np.float32), shape.triangles.astype(np.int32), shape.normals.astype(np.float32))
    write_ply(mesh, folder / file)
    return {"type": "mesh", **named, "file": file}
