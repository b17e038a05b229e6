"""Where a scene is read: from a folder of untrusted files to a SceneDescription."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path, PurePosixPath

import numpy as np

from renderer.errors import RayfarmError, SceneError
from renderer.formats import SCENE_SUFFIXES
from renderer.scene import sky
from renderer.scene.description import Environment, Material, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.studio import light_studio
from renderer.scene.textures import TextureShelf

__all__ = ["read"]

Reader = Callable[[SceneFiles, str, SceneDescription], None]


def read(folder: Path, main: str, environment: str | None = None) -> SceneDescription:
    """The scene in file `main` of a folder; names are relative to the folder, with forward slashes.

    environment: what lights the scene in place of its own environment: an HDR image of the folder, or a sky's
    "sky:ELEVATION[,AZIMUTH]" (renderer/scene/sky.py).

    A scene without any light is lit as in a studio, and a warning says so; so is, when it is compiled, a model whose lights
    are but accents (a car's tail lights), unless it is a scene file of ours, whose author says what is lit. Nothing outside
    the folder is opened. Raises SceneError with a sentence that names the file and says what to do.
    """
    files = SceneFiles(folder)
    description = SceneDescription(name=PurePosixPath(main).stem)
    read_into(files, main, description)
    if environment is not None:
        _light_with(files, environment, description)
    _check(main, description)
    if description.environment is None and not _emits(description):
        light_studio(description)
        description.warnings.append("The scene has no light: lit by a soft studio light. Give an environment to change that.")
    description.studio_for_accents = PurePosixPath(main).suffix.lower() not in (".yaml", ".yml")
    return description


def read_into(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the scene of one file to a description, by the reader of its format."""
    suffix = PurePosixPath(main).suffix.lower()
    if suffix not in SCENE_SUFFIXES:
        raise SceneError(f"{main}: is no scene file that is read here; give one of {', '.join(SCENE_SUFFIXES)}")
    try:
        _dispatch(suffix)(files, main, description)
    except (RayfarmError, MemoryError):
        raise
    # A parser that trips over a damaged file in a way nobody foresaw must not take the worker with it.
    except Exception as error:
        raise SceneError(
            f"{main}: could not be read as {suffix}; it may be damaged, export it again ({_reason(error)})"
        ) from error


def _dispatch(suffix: str) -> Reader:
    # Readers bring heavy libraries with them: each is imported when first needed.
    if suffix in (".glb", ".gltf"):
        from renderer.scene.readers import gltf

        return gltf.read
    if suffix == ".obj":
        from renderer.scene.readers import obj

        return obj.read
    if suffix in (".yaml", ".yml"):
        from renderer.scene.readers import yaml

        return yaml.read
    from renderer.scene.readers import other

    return other.read


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {str(error).splitlines()[0][:200]}" if str(error) else type(error).__name__


def _light_with(files: SceneFiles, name: str, description: SceneDescription) -> None:
    if name.startswith(sky.PREFIX):
        description.environment = sky.parse_sky(name)
        return
    shelf = TextureShelf(description, files)
    found = files.find(name, ".")
    if found is None:
        raise SceneError(f"{name}: the environment is not among the scene's files; add it")
    image = shelf.image_file(found)
    if image is None:
        raise SceneError(f"{name}: the environment could not be read; give an .exr or .hdr image in equirectangular projection")
    description.environment = Environment(image=image)


def _check(main: str, description: SceneDescription) -> None:
    if not description.materials:
        description.materials.append(Material())
    for mesh in description.meshes:
        if not np.isfinite(mesh.positions).all():
            raise SceneError(f"{main}: mesh {mesh.name} holds positions that are not finite numbers; export the file again")
    shown = sum(len(description.meshes[i.mesh].triangles) for i in description.instances) + len(description.spheres)
    if shown == 0:
        raise SceneError(f"{main}: shows no surface: no triangles and no spheres. Export it with its meshes")


def _emits(description: SceneDescription) -> bool:
    if any(max(light.intensity) > 0 for light in description.lights):
        return True
    used = {s.material for s in description.spheres}
    for instance in description.instances:
        used.add(description.meshes[instance.mesh].material if instance.material is None else instance.material)
    return any(max(description.materials[m].emission) > 0 for m in used)
