"""Wavefront's material files, as exporters write them.

An MTL says how to shade after Phong; here that becomes the nearest physical surface. Source: the Alias/Wavefront
specification, and the PBR additions Pr, Pm and map_Ke that Blender and others write.
"""

from __future__ import annotations

import math

from renderer.scene.description import Material, Vec3
from renderer.scene.files import SceneFiles
from renderer.scene.textures import TextureShelf

__all__ = ["read_mtl"]

# How many words follow each option of a map statement; the file's name, spaces and all, is the rest of the line.
_OPTIONS = {
    "-blendu": 1,
    "-blendv": 1,
    "-boost": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-mm": 2,
    "-bm": 1,
    "-texres": 1,
    "-type": 1,
}
_GLASS_MODELS = (4, 6, 7, 9)


def read_mtl(files: SceneFiles, name: str, shelf: TextureShelf) -> dict[str, Material]:
    """The materials of a file by name. Statements that cannot be understood give a warning each."""
    text = files.read(name).decode("utf-8", errors="replace")
    found: dict[str, _Statements] = {}
    current: _Statements | None = None
    for line in text.replace("\\\n", " ").splitlines():
        keyword, *rest = line.split(None, 1) or [""]
        value = rest[0].strip() if rest else ""
        if keyword.lower() == "newmtl":
            current = found.setdefault(value, _Statements(value, name, shelf))
        elif current is not None and keyword and not keyword.startswith("#"):
            current.values[keyword.lower()] = value
    return {material: _material(statements, files) for material, statements in found.items()}


class _Statements:
    """What a file says of one material: keywords, in lower case, and the rest of their lines."""

    def __init__(self, name: str, file: str, shelf: TextureShelf) -> None:
        self.name, self.file, self.shelf = name, file, shelf
        self.values: dict[str, str] = {}

    def numbers(self, keyword: str) -> list[float]:
        """The finite numbers of a statement; none, with a warning, where there are others or none is one."""
        words = self.values.get(keyword, "").split()
        try:
            values = [float(w) for w in words]
        except ValueError:
            values = [math.nan]
        if all(math.isfinite(v) for v in values):
            return values
        self.shelf.warn(f"{self.file}: material {self.name}: {keyword} {' '.join(words)[:40]} is not understood and left out.")
        return []

    def number(self, keyword: str, default: float) -> float:
        return next(iter(self.numbers(keyword)), default)

    def color(self, keyword: str, default: Vec3, high: float = 1.0) -> Vec3:
        """Three numbers, or one for grey, within 0..high."""
        values = self.numbers(keyword)
        if not values:
            return default
        r, g, b = (min(max(v, 0.0), high) for v in (values[:3] if len(values) >= 3 else values[:1] * 3))
        return r, g, b


def _material(said: _Statements, files: SceneFiles) -> Material:
    name = said.name
    diffuse, specular = said.color("kd", (0.8, 0.8, 0.8)), said.color("ks", (0.0, 0.0, 0.0))
    shininess = max(said.number("ns", 0.0), 0.0)
    model = int(said.number("illum", 2))
    material = Material(name, base_color=diffuse, emission=said.color("ke", (0.0, 0.0, 0.0), high=1e9))
    material.base_color_texture = _map(said, ("map_kd",), files)
    if material.base_color_texture is not None and max(diffuse) == 0:
        material.base_color = (1.0, 1.0, 1.0)  # written by exporters that let the map replace the colour
    material.emission_texture = _map(said, ("map_ke", "map_emissive"), files)
    if material.emission_texture is not None and max(material.emission) == 0:
        material.emission = (1.0, 1.0, 1.0)
    # Phong's exponent to GGX roughness: alpha^2 = 2 / (n + 2), roughness = sqrt(alpha). Source: Walter et al. 2007, Karis 2013.
    material.roughness = min(max(said.number("pr", (2 / (shininess + 2)) ** 0.25), 0.0), 1.0)
    material.metallic = min(max(said.number("pm", 0.0), 0.0), 1.0)
    material.ior = min(max(said.number("ni", 1.5), 1.0), 5.0)
    _choose_kind(material, model, specular, shininess, "pr" in said.values or "pm" in said.values)
    if material.kind not in ("glass", "mirror") and ("map_d" in said.values or 0 < said.number("d", 1.0) < 1):
        said.shelf.warn(f"Material {name}: its transparency is not rendered yet; it is opaque.")
    return material


def _choose_kind(material: Material, model: int, specular: Vec3, shininess: float, physical: bool) -> None:
    if model in _GLASS_MODELS:
        material.kind = "glass"
        material.base_color = (1.0, 1.0, 1.0)
        if material.ior <= 1.0:
            material.ior = 1.5
    elif model in (3, 5) and max(material.base_color) == 0 and max(specular) > 0:
        material.kind, material.base_color = "mirror", specular
    elif max(material.base_color) < 0.05 and max(specular) > 0.3 and material.base_color_texture is None and shininess > 1:
        material.kind, material.metallic, material.base_color = "metallic_roughness", 1.0, specular
    elif physical or (max(specular) > 0 and shininess > 1):
        material.kind = "metallic_roughness"


def _map(said: _Statements, keywords: tuple[str, ...], files: SceneFiles) -> int | None:
    for keyword in keywords:
        reference, scaled = _file_of(said.values.get(keyword, ""))
        if scaled:
            said.shelf.warn(f"Material {said.name}: the scale of its texture is left out.")
        if reference:
            return said.shelf.find(reference, said.file, f"Material {said.name}")
    return None


def _file_of(value: str) -> tuple[str, bool]:
    """The file that a map statement names, and whether its options move or scale the texture."""
    words = value.split()
    at, scaled = 0, False
    while at < len(words) and words[at].lower() in (*_OPTIONS, "-o", "-s", "-t"):
        option = words[at].lower()
        at += 1
        if option in _OPTIONS:
            at += _OPTIONS[option]
            continue
        last = at + 3  # one to three numbers
        while at < min(last, len(words)) and _is_number(words[at]):
            scaled |= float(words[at]) != (1 if option == "-s" else 0)
            at += 1
    return (value.split(None, at)[at].strip() if at < len(words) else ""), scaled


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
