"""The scenes of hard light, and the settings of a picture, as properties for LuxCore (luxcore_peer.py). Does not import it."""

from __future__ import annotations

from typing import Any, NamedTuple

from tests.benchmarks.hard.scenes import DEPTH, SIZE, HardScene, Surface

__all__ = ["METHODS", "LuxCoreMesh", "Properties", "luxcore_meshes", "picture_properties", "scene_properties"]

METHODS = ("path", "bidirectional", "caustic cache")
_LIGHT_DEPTH = 16
_NEVER = 100  # depth at which roulette begins
_ROW = 2.0 / SIZE  # height of a row of pixels in the camera's window
_CACHE_PHOTONS, _CACHE_ENTRIES, _CACHE_RADIUS = 500_000, 200_000, 0.03
Properties = dict[str, Any]


class LuxCoreMesh(NamedTuple):
    """A mesh as LuxCore's DefineMesh takes it: name, points, triangles, and normals or None."""

    name: str
    points: list[tuple[float, ...]]
    triangles: list[tuple[int, ...]]
    normals: list[tuple[float, ...]] | None


def luxcore_meshes(scene: HardScene) -> list[LuxCoreMesh]:
    """Returns the meshes of the scene's objects, to which `scene_properties` refers."""
    made = []
    for part in scene.parts:
        shape = part.shape
        normals = None if shape.normals is None else list(map(tuple, shape.normals.tolist()))
        points, triangles = list(map(tuple, shape.positions.tolist())), list(map(tuple, shape.triangles.tolist()))
        made.append(LuxCoreMesh(f"mesh-{_object(part.name)}", points, triangles, normals))
    return made


def _object(part: str) -> str:
    return part.replace(" ", "-")


def scene_properties(scene: HardScene) -> Properties:
    """Returns the properties of camera, materials, lights and objects."""
    made: Properties = {
        "scene.camera.type": "perspective",
        "scene.camera.lookat.orig": list(map(float, scene.eye)),
        "scene.camera.lookat.target": list(map(float, scene.target)),
        "scene.camera.up": [0.0, 1.0, 0.0],
        "scene.camera.fieldofview": float(scene.fov),
        "scene.camera.cliphither": 1e-3,
        "scene.camera.autofocus.enable": False,
        "scene.camera.screenwindow": [-1.0, 1.0, -1.0 - _ROW, 1.0 - _ROW],  # otherwise its pictures stand one row lower
    }
    for name, surface in scene.surfaces.items():
        made |= {f"scene.materials.{name}.{key}": value for key, value in _material(surface).items()}
    if scene.sky is not None:
        made |= {"scene.lights.sky.type": "constantinfinite", "scene.lights.sky.color": list(map(float, scene.sky))}
    if scene.sun is not None:
        made |= {
            "scene.lights.sun.type": "sharpdistant",
            "scene.lights.sun.direction": list(map(float, scene.sun.direction)),
            "scene.lights.sun.color": list(map(float, scene.sun.irradiance)),
        }
    for part in scene.parts:
        name = _object(part.name)
        made |= {f"scene.objects.{name}.shape": f"mesh-{name}", f"scene.objects.{name}.material": part.surface}
    return made


def _material(surface: Surface) -> Properties:
    color = list(map(float, surface.color))
    if surface.kind == "glass":
        white = [1.0, 1.0, 1.0]
        return {"type": "glass", "kr": white, "kt": white, "interiorior": float(surface.ior), "exteriorior": 1.0}
    if surface.kind == "light":
        return {"type": "matte", "kd": [0.0, 0.0, 0.0], "emission": color, "emission.gain": [1.0, 1.0, 1.0]}
    return {"type": "matte", "kd": color}


def picture_properties(method: str, samples: int, seed: int) -> Properties:
    """Returns the properties of a picture that one thread renders. method: of METHODS."""
    made: Properties = {
        "renderengine.type": "BIDIRCPU" if method == "bidirectional" else "PATHCPU",
        "renderengine.seed": seed + 1,
        "sampler.type": "SOBOL",
        "native.threads.count": 1,
        "film.width": SIZE,
        "film.height": SIZE,
        "film.filter.type": "NONE",
        "film.imagepipelines.0.0.type": "NOP",
        "film.imagepipelines.0.radiancescales.0.enabled": True,
        "film.outputs.0.type": "RGB",
        "film.outputs.0.filename": "picture.exr",
        "batch.haltspp": samples,
    }
    if method == "bidirectional":
        made |= {"path.maxdepth": _LIGHT_DEPTH, "light.maxdepth": _LIGHT_DEPTH}
        # With roulette from depth 5, pictures of `door` by LuxCore 2.11 have 1.28 of the light.
        made |= {f"{side}.russianroulette.depth": _NEVER for side in ("path", "light")}
        return made
    made |= {f"path.pathdepth.{kind}": DEPTH - 1 for kind in ("total", "diffuse", "glossy", "specular")}
    made["path.russianroulette.depth"] = 5
    if method == "caustic cache":
        made |= {
            "path.photongi.sampler.type": "RANDOM",
            "path.photongi.photon.maxcount": _CACHE_PHOTONS,
            "path.photongi.photon.maxdepth": _LIGHT_DEPTH,
            "path.photongi.caustic.enabled": True,
            "path.photongi.caustic.maxsize": _CACHE_ENTRIES,
            "path.photongi.caustic.lookup.radius": _CACHE_RADIUS,
            "path.photongi.caustic.updatespp": 16,
            "path.photongi.indirect.enabled": False,
        }
    return made
