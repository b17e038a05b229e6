"""glTF's surfaces: metallic-roughness (specification 3.9) and the extensions that have a counterpart here."""

from __future__ import annotations

import math
from typing import NamedTuple

from renderer.scene.description import Material, Vec3, Wrap
from renderer.scene.files import SceneFiles, data_uri
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.textures import TextureShelf

__all__ = ["Materials", "UvUse"]

_WRAP: dict[int, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
_GLASS_ROUGHNESS = 0.1  # above it, transmission is frosted, which the glass material is not


class UvUse(NamedTuple):
    """How a material looks up its textures: which TEXCOORD set, and the 2x3 matrix that its UVs go through first."""

    uv_set: int = 0
    transform: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


class Materials:
    """Reads the materials of one file; `uv_uses[i]` is how material i looks up its textures."""

    def __init__(self, root: Json, accessors: Accessors, files: SceneFiles, shelf: TextureShelf) -> None:
        self._root, self._accessors, self._files, self._shelf = root, accessors, files, shelf
        self._images = root.objects("images")
        self._samplers = root.objects("samplers")
        self._textures = root.objects("textures")
        self.uv_uses: list[UvUse] = []

    def read(self) -> list[Material]:
        """The materials in the file's order."""
        return [self._material(m, i) for i, m in enumerate(self._root.objects("materials"))]

    def _material(self, source: Json, index: int) -> Material:
        name = source.text("name", "") or f"material {index}"
        material = Material(name=name, kind="metallic_roughness", base_color=(1.0, 1.0, 1.0), metallic=1.0, roughness=1.0)
        uses: list[UvUse] = []
        pbr = source.object("pbrMetallicRoughness")
        glossy = source.extension("KHR_materials_pbrSpecularGlossiness")
        if glossy:
            self._specular_glossiness(glossy, material, uses)
        elif pbr:
            r, g, b, _ = pbr.vector("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
            material.base_color = _clamped((r, g, b))
            material.metallic = min(max(pbr.number("metallicFactor", 1.0), 0.0), 1.0)
            material.roughness = min(max(pbr.number("roughnessFactor", 1.0), 0.0), 1.0)
            material.base_color_texture = self._texture(pbr, "baseColorTexture", name, True, uses)
            material.metallic_roughness_texture = self._texture(pbr, "metallicRoughnessTexture", name, False, uses)
        self._emission(source, material, uses)
        material.double_sided = source.value.get("doubleSided") is True
        index_of_refraction = source.extension("KHR_materials_ior")
        if index_of_refraction:
            material.ior = min(max(index_of_refraction.number("ior", 1.5), 1.0), 5.0)
        self._transmission(source, material)
        self._say_what_is_left_out(source, material)
        if len(set(uses)) > 1:
            self._shelf.warn(f"Material {name}: its textures use several UV sets or transforms; all are looked up by the first.")
        self.uv_uses.append(uses[0] if uses else UvUse())
        return material

    def _specular_glossiness(self, source: Json, material: Material, uses: list[UvUse]) -> None:
        # Khronos has archived it, and many models still have it. Its specular colour has no counterpart but the metals'.
        r, g, b, _ = source.vector("diffuseFactor", (1.0, 1.0, 1.0, 1.0))
        material.base_color, material.metallic = _clamped((r, g, b)), 0.0
        material.roughness = 1.0 - min(max(source.number("glossinessFactor", 1.0), 0.0), 1.0)
        material.base_color_texture = self._texture(source, "diffuseTexture", material.name, True, uses)
        r, g, b = source.vector("specularFactor", (1.0, 1.0, 1.0))
        if "specularGlossinessTexture" in source:
            material.roughness = 0.6
            self._shelf.warn(f"Material {material.name}: its specular and glossiness texture is not rendered; it is half rough.")
        elif max(material.base_color) < 0.05 and max(r, g, b) > 0.3:
            material.base_color, material.metallic = _clamped((r, g, b)), 1.0

    def _emission(self, source: Json, material: Material, uses: list[UvUse]) -> None:
        factor = source.vector("emissiveFactor", (0.0, 0.0, 0.0))
        extension = source.extension("KHR_materials_emissive_strength")
        strength = extension.number("emissiveStrength", 1.0) if extension else 1.0
        r, g, b = (min(max(c * strength, 0.0), 1e9) for c in factor)
        material.emission = (r, g, b)
        if max(material.emission) > 0:
            texture = self._texture(source, "emissiveTexture", material.name, True, uses)
            material.emission_texture = texture
            if texture is None and "emissiveTexture" in source:
                material.emission = (0.0, 0.0, 0.0)  # better dark than a lamp where a few pixels should shine

    def _transmission(self, source: Json, material: Material) -> None:
        extension = source.extension("KHR_materials_transmission")
        if extension is None:
            return
        amount = extension.number("transmissionFactor", 0.0)
        textured = "transmissionTexture" in extension or material.metallic_roughness_texture is not None
        if amount >= 0.999 and (material.roughness or 0.0) <= _GLASS_ROUGHNESS and material.metallic == 0 and not textured:
            material.kind = "glass"
        elif amount > 0:
            self._shelf.warn(f"Material {material.name}: partial or rough transmission is not rendered yet; it is opaque.")

    def _say_what_is_left_out(self, source: Json, material: Material) -> None:
        mode = source.text("alphaMode", "OPAQUE")
        if mode != "OPAQUE":
            self._shelf.warn(f"Material {material.name}: alpha mode {mode[:20]} is not rendered yet; it is opaque.")
        if "normalTexture" in source:
            self._shelf.warn(f"Material {material.name}: its normal map is not rendered yet.")

    def _texture(self, owner: Json, key: str, user: str, srgb: bool, uses: list[UvUse]) -> int | None:
        info = owner.object(key)
        if info is None:
            return None
        index = info.integer("index", high=len(self._textures))
        uv_set = info.integer("texCoord", 0, high=64)
        transform = info.extension("KHR_texture_transform")
        use = _transformed(transform, uv_set) if transform else UvUse(uv_set)
        texture = self._textures[index]
        wrap_s, wrap_t = self._wrap(texture)
        image = self._image(texture, user, srgb)
        if image is None:
            return None
        uses.append(use)
        return self._shelf.texture(image, wrap_s, wrap_t)

    def _wrap(self, texture: Json) -> tuple[Wrap, Wrap]:
        sampler = texture.index("sampler", self._samplers)
        if sampler is None:
            return "repeat", "repeat"
        s, t = (self._samplers[sampler].integer(k, 10497) for k in ("wrapS", "wrapT"))
        return _WRAP.get(s, "repeat"), _WRAP.get(t, "repeat")

    def _image(self, texture: Json, user: str, srgb: bool) -> int | None:
        webp = texture.extension("EXT_texture_webp")
        index = (webp or texture).index("source", self._images)
        if index is None:
            self._shelf.warn(f"Material {user}: a texture has no image in a format that is read; rendered without it.")
            return None
        image = self._images[index]
        place = f"{self._root.file}: {image.where}"
        if "uri" in image:
            uri = image.text("uri", "")
            if uri.startswith("data:"):
                return self._shelf.image_bytes(place, data_uri(uri, place), srgb)
            name = self._files.resolve_uri(uri, self._root.file)
            if name is None:
                self._shelf.missing(uri, f"Material {user}")
                return None
            return self._shelf.image_file(name, srgb)
        view = image.integer("bufferView", high=len(self._accessors.views))
        name = f"{self._root.file}: {self._accessors.views[view].where}"  # several images may share one view
        return self._shelf.image_bytes(name, bytes(self._accessors.view_bytes(view)), srgb)


def _transformed(source: Json, uv_set: int) -> UvUse:
    # KHR_texture_transform: translation * rotation * scale on (u, v).
    (x, y), (width, height) = source.vector("offset", (0.0, 0.0)), source.vector("scale", (1.0, 1.0))
    angle = source.number("rotation", 0.0)
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix = (cosine * width, sine * height, x, -sine * width, cosine * height, y)
    return UvUse(source.integer("texCoord", uv_set, high=64), matrix)


def _clamped(color: tuple[float, float, float]) -> Vec3:
    r, g, b = (min(max(c, 0.0), 1.0) for c in color)
    return r, g, b
