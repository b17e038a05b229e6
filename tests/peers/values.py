"""Compares values that our readers return with Blender's values of the same scene: positions, lenses, lights and materials.

Blender's values are those of values_kit.py. Each function yields a sentence for each value that differs by more than NEAR.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from renderer.scene.description import Light, SceneDescription, Sphere
from tests.peers.blender import TO_Y_UP

__all__ = ["NEAR", "cameras_apart", "lights_apart", "materials_apart", "meshes_apart", "soup_apart"]

NEAR = 1e-4  # relative to the value or to the farthest coordinate


def meshes_apart(found: SceneDescription, told: dict[str, Any], turn: Any = TO_Y_UP) -> Iterator[str]:
    """Compares meshes by the positions of their vertices in world space, pairing each mesh of Blender with one of ours.

    told: values by values_kit.py. turn: rotation matrix from Blender's axes to the file's.
    """
    left = [_corners(found, i) for i in range(len(found.instances)) if not _is_lamp(found, i)]
    for name, count, vertices in told["meshes"]:
        wanted = np.array(vertices) @ turn.T
        same = [(_far(points, wanted), i) for i, (points, triangles) in enumerate(left) if triangles == count]
        if not same:
            yield f"{name}: nothing of ours has {count} triangles"
            continue
        far, i = min(same)
        if far > NEAR:
            yield f"{name}: the nearest body is {far:.1e} away"
        left.pop(i)
    if left:
        yield f"{len(left)} bodies more than Blender has"


def soup_apart(found: SceneDescription, told: dict[str, Any], turn: Any) -> Iterator[str]:
    """Compares the vertices of all meshes together, for formats that do not store separate objects."""
    ours = [_corners(found, i) for i in range(len(found.instances))]
    points, count = np.concatenate([each for each, _ in ours]), sum(triangles for _, triangles in ours)
    wanted = np.concatenate([np.array(vertices) for _, _, vertices in told["meshes"]]) @ turn.T
    if count != sum(each[1] for each in told["meshes"]):
        yield f"{count} triangles"
    elif (far := _far(points, wanted)) > NEAR:
        yield f"corners are {far:.1e} away"


def _corners(found: SceneDescription, number: int) -> tuple[Any, int]:
    shown = found.instances[number]
    mesh = found.meshes[shown.mesh]
    points = mesh.positions[np.unique(mesh.triangles)].astype(float)
    return points @ shown.transform[:3, :3].T + shown.transform[:3, 3], len(mesh.triangles)


def _is_lamp(found: SceneDescription, number: int) -> bool:
    shown = found.instances[number]
    return found.materials[found.meshes[shown.mesh].material if shown.material is None else shown.material].lamp


def _far(a: Any, b: Any) -> float:
    """Returns the Hausdorff distance of two point clouds, divided by the largest coordinate of `b` if that is above 1."""
    apart = max(cKDTree(a).query(b)[0].max(), cKDTree(b).query(a)[0].max())
    return float(apart / max(1.0, np.abs(b).max()))


def cameras_apart(found: SceneDescription, told: dict[str, Any]) -> Iterator[str]:
    """Compares the position, direction, clipping, shift, picture height and depth of field of each camera."""
    ours = {each.name: each.view for each in found.cameras}
    for name, said in told["cameras"].items():
        view = ours.get(name)
        if view is None:
            yield f"{name}: no camera"
            continue
        matrix = np.array(said["matrix"])
        forward = _unit(np.subtract(view.target, view.eye))
        up = _unit(np.array(view.up) - forward * np.dot(forward, view.up))
        corners = np.array(said["frame"])
        (left, low), (right, high) = corners[:, :2].min(0), corners[:, :2].max(0)
        tall = high - low
        got = {"eye": view.eye, "forward": forward, "up": up, "near": view.near}
        want = {"eye": TO_Y_UP @ matrix[:3, 3], "forward": _unit(TO_Y_UP @ -matrix[:3, 2])}
        want |= {"up": _unit(TO_Y_UP @ matrix[:3, 1]), "near": said["near"]}
        got |= {"shift": (view.shift_x, view.shift_y)}
        want |= {"shift": ((left + right) / 2 / tall, (low + high) / 2 / tall)}
        if said["kind"] == "ORTHO":
            got, want = got | {"height": view.height}, want | {"height": tall}
        else:
            got |= {"field": 2 * math.tan(math.radians(view.fov) / 2)}
            want |= {"field": tall / -corners[0, 2]}
        if said["focus"] is not None:
            got |= {"focus": view.focus or 0.0, "aperture": view.aperture}
            want |= {"focus": said["focus"], "aperture": said["lens"] / 1000 / 2 / said["stop"]}
        yield from _apart(name, got, want)


def lights_apart(found: SceneDescription, told: dict[str, Any]) -> Iterator[str]:
    """Compares the position, direction, size and cone of each light, and its power in watts per colour channel."""
    for name, said in told["lights"].items():
        shining = _shining(found, name)
        if shining is None:
            yield f"{name}: no light"
            continue
        watts, light = shining
        matrix = np.array(said["matrix"])
        got, want = {"watts": watts}, {"watts": np.multiply(said["color"], said["energy"])}
        if isinstance(light, Sphere):
            got |= {"place": light.center, "radius": light.radius}
            want |= {"place": TO_Y_UP @ matrix[:3, 3], "radius": said["radius"]}
        elif isinstance(light, Light):
            if light.kind != "point":
                got, want = got | {"direction": light.direction}, want | {"direction": _unit(TO_Y_UP @ -matrix[:3, 2])}
            if light.kind == "directional":
                got, want = got | {"angle": math.radians(light.angle)}, want | {"angle": said["angle"]}
            else:
                got |= {"place": light.position, "radius": light.radius}
                want |= {"place": TO_Y_UP @ matrix[:3, 3], "radius": said["radius"]}
            if light.kind == "spot":
                across, blend = said["spot"]
                edge = math.cos(across / 2)
                got |= {"cone": math.radians(2 * light.outer_cone), "full": math.cos(math.radians(light.inner_cone))}
                want |= {"cone": across, "full": edge + (1 - edge) * blend}
        yield from _apart(name, got, want)


def _shining(found: SceneDescription, name: str) -> tuple[Any, Light | Sphere | None] | None:
    """Returns (watts per colour channel, light) of our light with this name; None if there is none.

    For a sun, the watts are per square metre. If the light is an emissive mesh, the second element is None.
    """
    names = {name, name.replace(" ", "_")}
    for light in found.lights:
        if light.name in names:
            return np.multiply(light.intensity, 1 if light.kind == "directional" else 4 * math.pi), light
    for sphere in found.spheres:
        if sphere.name in names:
            return np.array(found.materials[sphere.material].emission) * (2 * math.pi * sphere.radius) ** 2, sphere
    for i, shown in enumerate(found.instances):
        if shown.name in names and _is_lamp(found, i):
            mesh = found.meshes[shown.mesh]
            a, b, c = ((mesh.positions @ shown.transform[:3, :3].T)[mesh.triangles[:, k]] for k in range(3))
            area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
            material = found.materials[mesh.material if shown.material is None else shown.material]
            return np.array(material.emission) * math.pi * area, None
    return None


def materials_apart(found: SceneDescription, told: dict[str, Any], known: tuple[str, ...]) -> Iterator[str]:
    """Compares materials with Blender's principled BSDFs.

    told: values of the BSDF's inputs, by material name. known: names of our parameters that the file format can store.
    """
    ours = {each.name.split("/")[-1].removesuffix("-material"): each for each in found.materials}
    for name, said in told.items():
        if name not in ours:
            yield f"{name}: no material"
            continue
        coat, sheen = said["Coat Weight"], said["Sheen Weight"]
        want = {
            "base_color": said["Base Color"][:3],
            "metallic": said["Metallic"],
            "roughness": said["Roughness"],
            "ior": said["IOR"],
            "opacity": said["Alpha"],
            "emission": [c * said["Emission Strength"] for c in said["Emission Color"][:3]],
            "clearcoat": coat,
            "clearcoat_roughness": said["Coat Roughness"] if coat else ours[name].clearcoat_roughness,
            "transmission": said["Transmission Weight"],
            "sheen_color": [c * sheen for c in said["Sheen Tint"][:3]],
            "sheen_roughness": said["Sheen Roughness"] if sheen else ours[name].sheen_roughness,
            "specular": min(2 * said["Specular IOR Level"], 1.0),
            "specular_color": said["Specular Tint"][:3],
            "anisotropy": said["Anisotropic"],
        }
        want = {key: value for key, value in want.items() if key in known}
        yield from _apart(name, {key: getattr(ours[name], key) for key in want}, want)


def _apart(name: str, got: dict[str, Any], want: dict[str, Any]) -> Iterator[str]:
    for key, value in want.items():
        far = float(np.abs(np.subtract(got[key], value)).max())
        if not far <= NEAR * max(1.0, float(np.abs(value).max())):
            yield f"{name}: {key} is {np.round(got[key], 6)}, and {np.round(value, 6)} in Blender"


def _unit(vector: Any) -> Any:
    return np.asarray(vector) / np.linalg.norm(vector)
