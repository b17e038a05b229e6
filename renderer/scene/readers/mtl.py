"""Reads Wavefront's material files (MTL).

MTL describes Phong shading, which is converted to the nearest physically based surface. Sources: the Alias/Wavefront
specification, and its extension for physically based shading by Clara.io (Pr, Pm, Ps, Pc, Pcr, aniso, anisor, norm), which
Blender and others write.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator

from renderer.scene.description import Vec3
from renderer.scene.files import SceneFiles
from renderer.scene.material import PARAMETERS, Material
from renderer.scene.readers.mtl_maps import Map, holds_normals, parse_map, with_decal, with_opacity, with_roughness_and_metal
from renderer.scene.readers.number_ranges import clamped, unit, unit_color
from renderer.scene.text_encoding import decoded
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["names_of", "read_mtl", "without_comment"]

# Statements about ambient light, rasterised reflections and antialiasing, which have no effect here.
_IGNORED_STATEMENTS = ("map_ka", "map_ao", "map_aat", "ka", "km", "illum", "sharpness")
_GLASS_MODELS = (4, 6, 7, 9)
_MATTE_MODELS = (0, 1)
# _BLENDERS_COATS: Blender imports clear coats at a quarter of their strength.
_METAL_MODEL, _SMOOTHEST, _BLENDERS_COATS = 3, 1000.0, 4.0
_PARAMETER_STATEMENTS = {p.mtl.lower(): p for p in PARAMETERS if p.mtl}
_BLENDERS = re.compile(r"# Blender \d+\.\d+")  # first line of files written by Blender 3.2 and later
_COMMENT = re.compile(r"(?:^|\s)#")
_CONTINUED = re.compile(r"\\[ \t]*\r?\n")
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_PHYSICAL = ("pr", "ps", "map_pr", "map_pm", *_PARAMETER_STATEMENTS)  # statements of physically based materials only


def read_mtl(files: SceneFiles, name: str, shelf: TextureShelf) -> dict[str, Material]:
    """Returns the materials of a file by name. Statements that cannot be parsed cause warnings."""
    text = decoded(files.read(name))
    found: dict[str, _Statements] = {}
    current: _Statements | None = None
    for keyword, value in _lines(text):
        if keyword == "newmtl":
            if value in found:
                found[value].notes.add(Sentence("mtl-names-clash", "the name of another material; they are merged"))
            current = found.setdefault(value, _Statements(value, name, shelf, files))
        elif current is not None:
            current.values[keyword] = value
    shade = _set_blender_surface if _BLENDERS.match(text) else _set_nearest_surface
    notes: Counter[str] = Counter()
    bare = Counter(map(without_comment, found))
    made = {}
    for material, statements in found.items():
        if bare[without_comment(material)] == 1:  # otherwise the apparent comment is part of a name, as in Material #25
            statements.name = without_comment(material)
        made[statements.name] = _material(statements, shade)
        notes.update(statements.notes)
    if commas := sum(statements.commas for statements in found.values()):
        shelf.warn_of_surface(
            Sentence(
                "mtl-decimal-commas",
                "{name}: {count} statements have decimal commas, which are read as points.",
                name=name,
                count=commas,
            )
        )
    for note, count in notes.items():
        shelf.warn_of_surface(
            Sentence("mtl-material-note", "{name}: 1 material has {note}.", name=name, note=note)
            if count == 1
            else Sentence("mtl-materials-note", "{name}: {count} materials have {note}.", name=name, count=count, note=note)
        )
    return made


def names_of(files: SceneFiles, name: str) -> list[str]:
    """Returns the names of a file's materials, in order."""
    return [value for keyword, value in _lines(decoded(files.read(name))) if keyword == "newmtl"]


def without_comment(words: str) -> str:
    """Returns the text of a statement without a trailing comment and surrounding blanks."""
    return _COMMENT.split(words, maxsplit=1)[0].strip() if "#" in words else words.strip()


def _lines(text: str) -> Iterator[tuple[str, str]]:
    """Yields (keyword in lower case, rest of the line) for each line; a backslash at the end of a line continues it."""
    for line in _CONTINUED.sub(" ", text).splitlines():
        keyword, *rest = line.split(None, 1) or [""]
        if keyword and not keyword.startswith("#"):
            yield keyword.lower(), rest[0].strip() if rest else ""


class _Statements:
    """The statements of one material: a dict from keyword, in lower case, to the rest of the line. Records which are used."""

    def __init__(self, name: str, file: str, shelf: TextureShelf, files: SceneFiles) -> None:
        self.name, self.file, self.shelf, self._files = name, file, shelf, files
        self.commas = 0  # statements whose numbers have decimal commas
        self.notes: set[str] = set()  # assumptions and omissions: rest of the sentence "3 materials have ..."
        self.values: dict[str, str] = {}
        self._asked: set[str] = set()

    def numbers(self, keyword: str) -> list[float]:
        """Returns the numbers of a statement; empty, with a warning, if any is invalid or not finite."""
        self._asked.add(keyword)
        text = without_comment(self.values.get(keyword, ""))
        if not text:
            return []
        if "," in text:
            text, commas = _DECIMAL_COMMA.subn(".", text)
            self.commas += commas > 0
        words = text.split()
        try:
            values = [float(w) for w in words]
        except ValueError:
            values = [math.nan]
        if all(math.isfinite(v) for v in values):
            return values
        self.shelf.warn_of_surface(
            Sentence(
                "mtl-statement-unknown",
                "{file}: material {name}: {keyword} {arguments} is unknown and left out.",
                file=self.file,
                name=self.name,
                keyword=keyword,
                arguments=" ".join(words)[:40],
            )
        )
        return []

    def number(self, keyword: str, default: float) -> float:
        return next(iter(self.numbers(keyword)), default)

    def color(self, keyword: str, default: Vec3, high: float = 1.0) -> Vec3:
        """Returns the colour of a statement with three numbers, or with one for grey, clamped to 0..high."""
        values = self.numbers(keyword)
        if not values:
            return default
        return unit_color(values[:3] if len(values) >= 3 else values[:1] * 3, high)

    def map(self, *keywords: str) -> Map | None:
        """Returns the first map statement, among those with the given keywords, that names a file; None if there is none."""
        self._asked |= {*keywords}
        maps = (parse_map(self.values[k], self._is_file) for k in keywords if k in self.values)
        return next((m for m in maps if m is not None), None)

    def _is_file(self, reference: str) -> bool:
        return self._files.find(reference, self.file) is not None

    def texture(self, *keywords: str, srgb: bool = False) -> int | None:
        found = self.map(*keywords)
        return (
            found.find(self.shelf, self.file, Sentence("label-material", "Material {name}", name=self.name), srgb)
            if found
            else None
        )

    def unread_maps(self) -> list[str]:
        """Returns the keywords of map statements that were not read; those without effect in this renderer are omitted."""
        return [keyword for keyword in self._unread_keywords() if _is_map(keyword)]

    def unused(self) -> list[str]:
        """Returns the keywords of other statements that were not read and whose values would change the material."""
        return [
            k
            for k in self._unread_keywords()
            if not _is_map(k) and without_comment(self.values[k]).split() not in _neutral_values(k)
        ]

    def _unread_keywords(self) -> list[str]:
        return [keyword for keyword in self.values if keyword not in self._asked and keyword not in _IGNORED_STATEMENTS]


def _is_map(keyword: str) -> bool:
    return keyword.startswith("map_") or keyword in ("disp", "refl", "bump", "norm", "decal")


def _neutral_values(keyword: str) -> Iterator[list[str]]:
    """Yields the neutral values of a statement, as lists of words: 1 for opacity (d), 0 or 1 for a filter (tf), otherwise 0."""
    for value in (1.0,) if keyword == "d" else (0.0, 1.0) if keyword == "tf" else (0.0,):
        for word in (f"{value:g}", *(f"{value:.{digits}f}" for digits in range(1, 9))):
            yield [word]
            yield [word] * 3


def _material(statements: _Statements, shade: Callable[[_Statements, Material], None]) -> Material:
    diffuse = statements.color("kd", (0.8, 0.8, 0.8))
    material = Material(statements.name, base_color=diffuse, emission=statements.color("ke", (0.0, 0.0, 0.0), high=1e9))
    material.base_color_texture = statements.texture("map_kd", srgb=True)
    if material.base_color_texture is not None and (max(diffuse) == 0 or "kd" not in statements.values):
        material.base_color = (1.0, 1.0, 1.0)  # some exporters write 0 if the map replaces the colour
        if "kd" in statements.values:
            statements.notes.add(Sentence("mtl-black-kd-with-map", "a black Kd beside map_Kd, read as white"))
    _decal(statements, material, diffuse)
    material.emission_texture = statements.texture("map_ke", "map_emissive", srgb=True)
    if material.emission_texture is not None and max(material.emission) == 0:
        material.emission = (1.0, 1.0, 1.0)
    _normals(statements, material)
    index = clamped(statements.number("ni", 1.5), 1.0, 5.0)
    material.ior = index if index > 1.0 else 1.5  # exporters write 1 if the index is unknown
    shade(statements, material)
    if index <= 1.0 and material.kind in ("glass", "metallic_roughness") and material.metallic < 1:
        statements.notes.add(Sentence("mtl-ior-too-low", "an index of refraction (Ni) of at most 1, read as 1.5"))
    if material.kind not in ("glass", "mirror"):
        _opacity(statements, material)
    if left := statements.unread_maps():
        statements.shelf.warn_of_surface(
            Sentence(
                "mtl-textures-dropped",
                "Material {name}: not supported and left out: the textures of {textures}.",
                name=statements.name,
                textures=[*left],
            )
        )
    if unused := statements.unused():
        listed = [f"{keyword} {statements.values[keyword]}"[:40] for keyword in unused]
        statements.shelf.warn_of_surface(
            Sentence(
                "material-parts-dropped",
                "Material {name}: not supported and left out: {parts}.",
                name=statements.name,
                parts=listed,
            )
        )
    return material


def _set_nearest_surface(statements: _Statements, material: Material) -> None:
    """Sets the material's surface: the physically based parameters in the file or, for absent ones, those nearest to Phong's."""
    specular, shininess = statements.color("ks", (0.0, 0.0, 0.0)), max(statements.number("ns", 0.0), 0.0)
    # Phong's exponent to GGX roughness: alpha^2 = 2 / (n + 2), roughness = sqrt(alpha). Source: Walter et al. 2007, Karis 2013.
    roughness = unit(statements.number("pr", (2 / (shininess + 2)) ** 0.25))
    _choose_kind(statements, material, specular, shininess)
    if material.kind == "metallic_roughness":
        _physical(statements, material, roughness, specular)


def _set_blender_surface(statements: _Statements, material: Material) -> None:
    """Sets the surface of a material that Blender wrote, as Blender's own importer does.

    Ns is read as the roughness, d as the opacity, and Ka as the metalness if illum is 3. Tf is read as the transmission if the
    file uses the extension for physically based shading.
    """
    material.double_sided = True  # Blender's surfaces emit on both sides
    material.kind, is_extended = "metallic_roughness", any(keyword in statements.values for keyword in _PHYSICAL)
    roughness = unit(statements.number("pr", 1 - math.sqrt(clamped(statements.number("ns", 0.0), 0.0, _SMOOTHEST) / _SMOOTHEST)))
    _physical(statements, material, roughness, statements.color("ks", (0.5, 0.5, 0.5)))
    rough, metal = statements.texture("map_pr", "map_ns"), statements.texture("map_pm", "map_refl")
    if not is_extended:
        material.metallic = (
            sum(statements.color("ka", (1.0, 1.0, 1.0))) / 3 if statements.number("illum", 2) == _METAL_MODEL else 0.0
        )
    if rough is not None or metal is not None:
        material.metallic_roughness_texture = with_roughness_and_metal(statements.shelf, rough, metal)
        material.roughness = 1.0 if rough is not None else roughness
        material.metallic = 1.0 if metal is not None else material.metallic
    if is_extended:
        material.clearcoat = unit(statements.number("pc", 0.0) / _BLENDERS_COATS)
        material.transmission = unit(max(statements.color("tf", (0.0, 0.0, 0.0))))


def _decal(statements: _Statements, material: Material, color: Vec3) -> None:
    decal = statements.texture("decal")
    if decal is None:
        return
    if material.base_color_texture is None:
        statements.shelf.warn_of_surface(
            Sentence(
                "mtl-decal-without-map",
                "Material {name}: its decal is left out, since there is no map_Kd.",
                name=statements.name,
            )
        )
        return
    material.base_color_texture = with_decal(statements.shelf, material.base_color_texture, decal, color)
    material.base_color = (1.0, 1.0, 1.0)


def _choose_kind(statements: _Statements, material: Material, specular: Vec3, shininess: float) -> None:
    model = int(clamped(statements.number("illum", 2), 0, 10))
    black = max(material.base_color) < 0.05 and material.base_color_texture is None
    if any(keyword in statements.values for keyword in _PHYSICAL):
        material.kind = "metallic_roughness"
    elif model in _GLASS_MODELS:
        material.kind, material.base_color = "glass", statements.color("tf", (1.0, 1.0, 1.0))
        if material.base_color_texture is not None:
            statements.notes.add(Sentence("mtl-glass-texture-dropped", "a texture (map_Kd) on glass, which is left out"))
        material.base_color_texture = None
    elif model in (3, 5) and black and max(specular) > 0:
        material.kind, material.base_color = "mirror", specular
    elif black and max(specular) > 0.3 and shininess > 1:
        material.kind, material.metallic, material.base_color = "metallic_roughness", 1.0, specular
    elif max(specular) > 0 and shininess > 1 and model not in _MATTE_MODELS:
        material.kind = "metallic_roughness"


def _physical(statements: _Statements, material: Material, roughness: float, specular: Vec3) -> None:
    material.roughness = roughness
    for keyword, parameter in _PARAMETER_STATEMENTS.items():
        setattr(material, parameter.name, parameter.clamped(statements.number(keyword, getattr(material, parameter.name))))
    rough, metal = statements.texture("map_pr"), statements.texture("map_pm")
    material.metallic_roughness_texture = with_roughness_and_metal(statements.shelf, rough, metal)
    if rough is not None and "pr" not in statements.values:
        material.roughness = 1.0
    if metal is not None and "pm" not in statements.values:
        material.metallic = 1.0
    if "ks" in statements.values and material.metallic == 0:
        material.specular = unit(2 * max(specular))  # exporters write 0.5 for a reflectance of 4 %
    tint = statements.texture("map_ks", srgb=True)
    if material.metallic == 1 and material.base_color_texture is None and "pm" not in statements.values:
        material.base_color_texture = tint  # a Phong metal has the colour of its highlights
    else:
        material.specular_color_texture = tint
    material.anisotropy_rotation = math.remainder(2 * math.pi * statements.number("anisor", 0.0), 2 * math.pi)
    sheen = unit(statements.number("ps", 0.0))
    if sheen > 0:
        material.sheen_color, material.sheen_roughness = (sheen, sheen, sheen), 0.5


def _normals(statements: _Statements, material: Material) -> None:
    material.normal_texture = statements.texture("norm")
    bump = statements.map("map_bump", "bump")
    if material.normal_texture is None and bump is not None:
        texture = bump.find(
            statements.shelf, statements.file, Sentence("label-material", "Material {name}", name=statements.name)
        )
        if texture is not None and holds_normals(statements.shelf.image_of(texture)):
            material.normal_texture, material.normal_scale = texture, clamped(bump.strength, -100.0, 100.0)
            statements.notes.add(Sentence("mtl-bump-read-as-normal", "a bump map of mostly blue pixels, read as a normal map"))
        elif texture is not None:
            statements.shelf.warn_of_surface(
                Sentence(
                    "material-bump-heights-dropped",
                    "Material {name}: its bump map contains heights and is left out; bake it to a normal map.",
                    name=statements.name,
                )
            )


def _opacity(statements: _Statements, material: Material) -> None:
    values = statements.numbers("d")  # `d -halo 0.5` gives no numbers, and a warning
    opacity = values[0] if values else 1 - statements.number("tr", 0.0)
    if 0 < opacity < 1:  # some exporters write 0 for opaque
        material.opacity, material.alpha_mode = opacity, "blend"
    elif opacity <= 0:
        statements.notes.add(Sentence("mtl-opacity-zero", "an opacity of 0 (d 0 or Tr 1), read as opaque"))
    mask = statements.texture("map_d", "map_opacity", "map_tr")
    if mask is not None:
        material.base_color_texture = with_opacity(statements.shelf, material.base_color_texture, mask)
        material.alpha_mode = "blend"
