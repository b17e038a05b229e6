"""Wavefront's material files, as exporters write them.

An MTL says how to shade after Phong; here that becomes the nearest physical surface. Source: the Alias/Wavefront
specification, and the PBR additions Pr, Pm and map_Ke that Blender and others write.
"""

from __future__ import annotations

import math
from collections.abc import Callable

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
    """The materials of a file by name. Lines that cannot be understood give a warning each."""
    text = files.read(name).decode("utf-8", errors="replace")
    found: dict[str, dict[str, str]] = {}
    current: dict[str, str] | None = None
    for line in text.replace("\\\n", " ").splitlines():
        keyword, _, rest = (
            line.strip().partition(" ") if "\t" not in line.strip() else line.strip().replace("\t", " ").partition(" ")
        )
        keyword, rest = keyword.lower(), rest.strip()
        if not keyword or keyword.startswith("#"):
            continue
        if keyword == "newmtl":
            current = found.setdefault(rest, {})
        elif current is not None:
            current[keyword] = rest
    return {material: _material(material, lines, files, name, shelf) for material, lines in found.items()}


def _material(name: str, lines: dict[str, str], files: SceneFiles, beside: str, shelf: TextureShelf) -> Material:
    def warn(keyword: str) -> None:
        shelf.warn(f"{beside}: material {name}: {keyword} {lines[keyword][:40]} is not understood and left out.")

    def numbers(keyword: str) -> list[float]:
        try:
            values = [float(v) for v in lines.get(keyword, "").split()]
        except ValueError:
            warn(keyword)
            return []
        return values if all(math.isfinite(v) for v in values) else []

    def color(keyword: str, default: Vec3) -> Vec3:
        values = numbers(keyword)
        if not values:
            return default
        r, g, b = (values * 3)[:3] if len(values) < 3 else values[:3]
        return min(max(r, 0.0), 1e9), min(max(g, 0.0), 1e9), min(max(b, 0.0), 1e9)

    def number(keyword: str, default: float) -> float:
        values = numbers(keyword)
        return values[0] if values else default

    diffuse = _clamped(color("kd", (0.8, 0.8, 0.8)))
    specular = _clamped(color("ks", (0.0, 0.0, 0.0)))
    shininess = max(number("ns", 0.0), 0.0)
    model = int(number("illum", 2))
    material = Material(name, base_color=diffuse, emission=color("ke", (0.0, 0.0, 0.0)))
    material.base_color_texture = _map(lines, ("map_kd",), name, files, beside, shelf)
    if material.base_color_texture is not None and max(diffuse) == 0:
        material.base_color = (1.0, 1.0, 1.0)  # written by exporters that let the map replace the colour
    material.emission_texture = _map(lines, ("map_ke", "map_emissive"), name, files, beside, shelf)
    if material.emission_texture is not None and max(material.emission) == 0:
        material.emission = (1.0, 1.0, 1.0)
    # Phong's exponent to GGX roughness: alpha^2 = 2 / (n + 2), roughness = sqrt(alpha). Source: Walter et al. 2007, Karis 2013.
    material.roughness = min(max(number("pr", (2 / (shininess + 2)) ** 0.25), 0.0), 1.0)
    material.metallic = min(max(number("pm", 0.0), 0.0), 1.0)
    material.ior = min(max(number("ni", 1.5), 1.0), 5.0)
    _choose_kind(material, model, specular, shininess, "pr" in lines or "pm" in lines)
    if material.kind not in ("glass", "mirror") and ("map_d" in lines or 0 < number("d", 1.0) < 1):
        shelf.warn(f"Material {name}: its transparency is not rendered yet; it is opaque.")
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


def _map(
    lines: dict[str, str], keywords: tuple[str, ...], user: str, files: SceneFiles, beside: str, shelf: TextureShelf
) -> int | None:
    for keyword in keywords:
        reference = _file_of(
            lines.get(keyword, ""), lambda: shelf.warn(f"Material {user}: the scale of its texture is left out.")
        )
        if reference:
            return shelf.find(reference, beside, f"Material {user}")
    return None


def _file_of(rest: str, scaled: Callable[[], None]) -> str:
    words = rest.split()
    while words and words[0].lower() in (*_OPTIONS, "-o", "-s", "-t"):
        option = words.pop(0).lower()
        taken = _OPTIONS.get(option)
        if taken is None:  # one to three numbers
            scaled()
            while words and _is_number(words[0]):
                words.pop(0)
        else:
            del words[:taken]
    return rest[rest.index(words[0]) :].strip() if words and words[0] in rest else ""


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _clamped(color: Vec3) -> Vec3:
    return min(color[0], 1.0), min(color[1], 1.0), min(color[2], 1.0)
