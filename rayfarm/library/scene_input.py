"""Converts a program's scene (file, dict, trimesh) to files in a folder, the only input of the renderer and of a farm."""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rayfarm.library.glb import ATTRIBUTES, mesh_as_glb
from rayfarm.scene_files import files_to_upload
from renderer.errors import SceneError

__all__ = ["as_files"]

_FILE_NAME_KEYS = ("file", "image", "picture", "profile")  # keys whose value is a file name


@contextlib.contextmanager
def as_files(scene: Any, base: str | Path = ".") -> Iterator[Path]:
    """Context manager that yields the path of the scene's file, in a folder with all files that it refers to.

    scene: the path of a scene, a folder or an archive; a dict as in docs/scene-format.md, in which a mesh may have arrays
    (positions, triangles, normals, uvs, uvs1, colors) in place of `file` and a texture or the environment `pixels` in place of
    `image`; or a trimesh.Trimesh, Scene or PointCloud. base: the folder of files that a dict names.
    Raises SceneError for any other type, or an invalid array.
    """
    if isinstance(scene, str | Path):
        yield Path(scene).expanduser()
        return
    with tempfile.TemporaryDirectory(prefix="rayfarm-") as folder:
        if isinstance(scene, Mapping) and scene.get("type") == "scene":
            raise SceneError(
                "This dict is one of Mitsuba's: write it down by mitsuba.xml.dict_to_xml(scene, 'scene.xml') and give the file, "
                "or say it as docs/scene-format.md has it"
            )
        if isinstance(scene, Mapping):
            yield _write_scene(scene, Path(folder), Path(base).expanduser())
        elif hasattr(scene, "export") and type(scene).__module__.partition(".")[0] == "trimesh":
            kind = "ply" if type(scene).__name__ == "PointCloud" else "glb"  # its points are shown as spheres
            path = Path(folder) / f"scene.{kind}"
            path.write_bytes(scene.export(file_type=kind))
            yield path
        else:
            raise SceneError(
                f"A scene is a path, a dict as docs/scene-format.md describes it, or a trimesh; this is {type(scene).__name__}"
            )


def _write_scene(scene: Mapping[str, Any], folder: Path, base: Path) -> Path:
    name = scene.get("name")
    path = folder / "scene.yaml"
    document = _Writer(folder, base).json_value(scene, "scene")
    document.setdefault("name", name or "scene")
    # JSON is valid YAML, except for Python's NaN and Infinity, which the reader refuses.
    path.write_text(json.dumps(document))
    return path


class _Writer:
    """Converts a scene dict to JSON values, with its arrays written as files in the folder."""

    def __init__(self, folder: Path, base: Path) -> None:
        self._folder, self._base = folder, base
        self._linked: dict[Path, str] = {}
        self._count = 0

    def json_value(self, value: Any, where: str) -> Any:
        """Returns a value as JSON data, with arrays replaced by files. where: location in the dict, for error messages."""
        if isinstance(value, Mapping):
            found = {str(key): each for key, each in value.items()}
            if found.get("type") == "mesh" and "file" not in found:
                found = self._mesh(found, where)
            if "pixels" in found:
                found = self._image(found, where)
            return {
                key: self._link(each, where)
                if key in _FILE_NAME_KEYS and isinstance(each, str | Path)
                else self.json_value(each, f"{where}.{key}")
                for key, each in found.items()
            }
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        if isinstance(value, list | tuple):
            return [self.json_value(each, f"{where}[{i}]") for i, each in enumerate(value)]
        if value is None or isinstance(value, str | int | float | bool):
            return value
        if isinstance(value, Path):
            return str(value)
        raise SceneError(f"{where} is {type(value).__name__}; a scene holds dicts, lists, numbers, text and arrays")

    def _mesh(self, shape: dict[str, Any], where: str) -> dict[str, Any]:
        arrays = {name: shape.pop(name) for name in (*ATTRIBUTES, "triangles") if name in shape}
        name = str(shape.get("name", where))
        file = self._new_file_name(".glb")
        (self._folder / file).write_bytes(mesh_as_glb(name, arrays))
        return {**shape, "file": self._folder / file}

    def _image(self, holder: dict[str, Any], where: str) -> dict[str, Any]:
        from renderer.image import encode

        pixels = np.asarray(holder.pop("pixels"))
        if pixels.ndim == 2:
            pixels = np.repeat(pixels[..., None], 3, axis=2)
        if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or not pixels.size or pixels.dtype.kind not in "uf":
            raise SceneError(
                f"{where}: pixels are {pixels.shape} of {pixels.dtype}; they take (h, w), (h, w, 3) or, of uint8, (h, w, 4)"
            )
        if pixels.dtype == np.uint8:
            file = self._new_file_name(".png")
            from PIL import Image

            Image.fromarray(np.ascontiguousarray(pixels)).save(self._folder / file)
        elif pixels.dtype.kind == "f" and pixels.shape[2] == 3:
            file = self._new_file_name(".exr")
            (self._folder / file).write_bytes(encode.encode(np.asarray(pixels, np.float32), "exr"))
        else:
            raise SceneError(f"{where}: pixels are of {pixels.dtype}; they take uint8 as a screen has them, or floats (h, w, 3)")
        return {**holder, "image": self._folder / file}

    def _link(self, named: str | Path, where: str) -> str:
        """Links a file named in a scene dict, and all files that this file refers to, into the folder. Returns its name there."""
        path = (self._base / Path(named).expanduser()).resolve()
        if path.parent == self._folder.resolve():
            return path.name
        if path not in self._linked:
            if not path.is_file():
                raise SceneError(f"{where}: there is no file {path}")
            self._count += 1
            inside = f"file-{self._count}"
            for name, source in files_to_upload(path).items():
                target = self._folder / inside / name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)
            self._linked[path] = f"{inside}/{path.name}"
        return self._linked[path]

    def _new_file_name(self, suffix: str) -> str:
        self._count += 1
        return f"arrays-{self._count}{suffix}"
