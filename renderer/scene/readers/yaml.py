"""Our own scene file (docs/scene-format.md): YAML, and so JSON, held to the schema in renderer/scene/schema.json."""

from __future__ import annotations

import functools
import json
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

import jsonschema
import numpy as np

from renderer.errors import SettingsError
from renderer.formats import SCENE_SUFFIXES
from renderer.scene.description import Camera, Environment, Image, Instance, Material, SceneDescription, Sphere, Vec3
from renderer.scene.files import SceneFiles
from renderer.scene.geometry import MAX_TRIANGLES
from renderer.scene.merge import merge
from renderer.scene.readers import shapes, transforms
from renderer.scene.readers.yaml_lines import Path, Yaml, parse
from renderer.scene.textures import TextureShelf
from renderer.settings import View

__all__ = ["SCHEMA_FILE", "read"]

SCHEMA_FILE = PurePosixPath("schema.json")

_CHECKER_PIXELS = 32  # of one square; its edges are then sharp to a thirtieth of it


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's scene to the description. Raises SceneError with line and field."""
    document = parse(files.read(main), main)
    _validate(document)
    _Reader(document, files, description).read()


@functools.cache
def _validator() -> Any:
    from importlib.resources import files as resources

    schema = json.loads(resources("renderer.scene").joinpath(str(SCHEMA_FILE)).read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def _validate(document: Yaml) -> None:
    error = jsonschema.exceptions.best_match(_validator().iter_errors(document.data))
    if error is not None:
        path = tuple(error.absolute_path)
        message = "does not belong here" if error.validator is None else error.message
        if len(message) > 300:
            message = f"{message[:120]} ... {message[-120:]}"
        raise document.error(path, f"{message}. See docs/scene-format.md")


class _Reader:
    def __init__(self, document: Yaml, files: SceneFiles, description: SceneDescription) -> None:
        self._document, self._files, self._description = document, files, description
        self._data: dict[str, Any] = document.data
        self._shelf = TextureShelf(description, files)
        self._textures: dict[str, int | None] = {}
        self._materials: dict[str, int] = {}
        self._plain: int | None = None
        self._parts: dict[tuple[str, int | None], list[Instance]] = {}  # of mesh files that were read before
        self._triangles = 0

    def read(self) -> None:
        self._description.name = self._data.get("name", self._description.name)
        self._description.defaults.update(self._data.get("settings", {}))
        for i, camera in enumerate(self._data.get("cameras", [])):
            self._camera(camera, i)
        self._environment()
        for name, texture in self._data.get("textures", {}).items():
            self._textures[name] = self._texture(texture, ("textures", name))
        for name, material in self._data.get("materials", {}).items():
            self._description.materials.append(self._material(name, material, ("materials", name)))
            self._materials[name] = len(self._description.materials) - 1
        for i, shape in enumerate(self._data["shapes"]):
            self._shape(shape, ("shapes", i))

    def _camera(self, source: dict[str, Any], index: int) -> None:
        try:
            view = View(
                _vec3(source["eye"]), _vec3(source["target"]), _vec3(source.get("up", (0, 1, 0))), float(source.get("fov", 40))
            )
        except SettingsError as error:
            raise self._document.error(("cameras", index), str(error)) from error
        name = source.get("name", f"camera {index}")
        if name in {c.name for c in self._description.cameras}:
            raise self._document.error(("cameras", index, "name"), f"another camera is called {name}; give it another name")
        self._description.cameras.append(Camera(name, view))

    def _environment(self) -> None:
        source = self._data.get("environment")
        if source is None:
            return
        image = None
        if "image" in source:
            name = self._files.find(source["image"], self._document.file)
            if name is None:
                raise self._document.error(("environment", "image"), f"{source['image'][:120]} is not among the files; add it")
            image = self._shelf.image_file(name)
        self._description.environment = Environment(
            _radiance(source.get("color", 1.0)), image, float(source.get("strength", 1)), float(source.get("rotation", 0))
        )

    def _texture(self, source: dict[str, Any], path: Path) -> int | None:
        wrap = source.get("wrap", "repeat")
        if ("image" in source) == ("checker" in source):
            raise self._document.error(path, "has one of image and checker")
        if "image" in source:
            name = self._files.find(source["image"], self._document.file)
            if name is None:
                self._shelf.missing(source["image"], f"Texture {path[-1]}")
                return None
            return self._shelf.texture(self._shelf.image_file(name, source.get("encoding", "srgb") == "srgb"), wrap, wrap)
        checker = source["checker"]
        squares = checker.get("squares", 8)
        even, odd = (np.array(_srgb_bytes(_color(c)), np.uint8) for c in checker["colors"])
        i = np.arange(squares * _CHECKER_PIXELS) // _CHECKER_PIXELS
        pixels = np.where(((i[:, None] + i) % 2 == 0)[..., None], even, odd).astype(np.uint8)
        opaque = np.full((*pixels.shape[:2], 1), 255, np.uint8)
        return self._shelf.texture(self._shelf.add(Image(str(path[-1]), np.concatenate([pixels, opaque], axis=2))), wrap, wrap)

    def _material(self, name: str, source: dict[str, Any], path: Path) -> Material:
        def texture(key: str) -> int | None:
            if key not in source:
                return None
            if source[key] not in self._textures:
                raise self._document.error((*path, key), f"no texture is called {source[key][:80]}; describe it under textures")
            return self._textures[source[key]]

        kind = source.get("kind", "diffuse")
        return Material(
            name=name,
            kind=kind,
            base_color=_color(source.get("color", 1.0 if "texture" in source or kind in ("glass", "mirror") else 0.8)),
            base_color_texture=texture("texture"),
            metallic=float(source.get("metallic", 0)),
            roughness=float(source.get("roughness", 1)),
            metallic_roughness_texture=texture("metallic_roughness_texture"),
            ior=float(source.get("ior", 1.5)),
            emission=_radiance(source.get("emission", 0.0)),
            emission_texture=texture("emission_texture"),
            double_sided=bool(source.get("double_sided", False)),
        )

    def _shape(self, source: dict[str, Any], path: Path) -> None:
        own = transforms.matrix(source.get("transform", []), self._document, (*path, "transform"))
        placed = [own]
        if "instances" in source:
            placed = [
                transforms.matrix(t, self._document, (*path, "instances", i)) @ own for i, t in enumerate(source["instances"])
            ]
        name = source.get("name", f"{source['type']} {path[-1]}")
        material = self._material_of(source, path)
        if source["type"] == "sphere":
            self._spheres(source, name, material, placed, path)
            return
        if source["type"] == "mesh":
            self._mesh_file(source, material, placed, path)
            return
        if source["type"] == "lathe":
            mesh = shapes.lathe(name, [(r, y) for r, y in source["profile"]], source.get("segments", 96))
        elif source["type"] == "disk":
            mesh = shapes.disk(name, source.get("segments", 256))
        else:
            mesh = shapes.quad(name) if source["type"] == "quad" else shapes.cube(name)
        self._triangles += len(mesh.triangles)
        if self._triangles > MAX_TRIANGLES:
            raise self._document.error(path, f"with it the scene has more than {MAX_TRIANGLES} triangles; use fewer segments")
        mesh.material = self._plain_material() if material is None else material
        self._description.meshes.append(mesh)
        self._description.instances += [Instance(len(self._description.meshes) - 1, m) for m in placed]

    def _spheres(self, source: dict[str, Any], name: str, material: int | None, placed: list[Any], path: Path) -> None:
        for matrix in placed:
            scale = transforms.uniform_scale(matrix)
            if scale is None:
                raise self._document.error(path, "a sphere is scaled alike in all directions; a transform here is not so")
            center = matrix @ np.array([*source.get("center", (0, 0, 0)), 1.0])
            number = self._plain_material() if material is None else material
            self._description.spheres.append(Sphere(_vec3(center[:3]), float(source.get("radius", 1)) * scale, number, name))

    def _mesh_file(self, source: dict[str, Any], material: int | None, placed: list[Any], path: Path) -> None:
        from renderer.scene.load import read_into  # which imports this reader in turn

        name = self._files.find(source["file"], self._document.file)
        if name is None:
            raise self._document.error((*path, "file"), f"{source['file'][:120]} is not among the files; add it")
        suffix = PurePosixPath(name).suffix.lower()
        if suffix in (".yaml", ".yml") or suffix not in SCENE_SUFFIXES:
            others = ", ".join(s for s in SCENE_SUFFIXES if s not in (".yaml", ".yml"))
            raise self._document.error((*path, "file"), f"{name[:120]} is no mesh file; give one of {others}")
        if (name, material) not in self._parts:
            part = SceneDescription(name=name)
            read_into(self._files, name, part)
            self._parts[name, material] = merge(part, self._description, material)
        shown = self._parts[name, material]
        self._description.instances += [replace(s, transform=m @ s.transform) for m in placed for s in shown]

    def _material_of(self, source: dict[str, Any], path: Path) -> int | None:
        name = source.get("material")
        if name is None:
            return None
        if name not in self._materials:
            known = ", ".join(sorted(self._materials)[:10]) or "none"
            raise self._document.error((*path, "material"), f"no material is called {name[:80]}; known are {known}")
        return self._materials[name]

    def _plain_material(self) -> int:
        if self._plain is None:
            self._description.materials.append(Material())
            self._plain = len(self._description.materials) - 1
        return self._plain


def _vec3(values: Any) -> Vec3:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _radiance(value: Any) -> Vec3:
    return _vec3(value if isinstance(value, list | tuple) else [value] * 3)


def _color(value: Any) -> Vec3:
    if not isinstance(value, str):
        return _radiance(value)
    encoded = [int(value[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return _vec3([c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in encoded])


def _srgb_bytes(linear: Vec3) -> list[int]:
    return [round(255 * (12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055)) for c in linear]
