"""Exports Blender's materials to glTF: the Principled BSDF as far as glTF supports it, and simpler shaders by its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..farm.protocol.sentences import Sentence
from . import fibres, subsurface
from .cycles import warn_of_material
from .cycles_differences import has_film, warn_of_pictures
from .displacement import DISPLACEMENT, Heights, displaced
from .model import Material, Scene, TextureUse
from .nodes import Product, SocketInGroups, Source, constant_value, output_of, source_of
from .pictures import Pictures
from .shader_mix import PrincipledLook, brushed, input_for_camera_rays, principled_look, under_coat
from .textures import GREY, Value, Values, as_list, number, one_minus

__all__ = ["Surfaces"]

WHITE, BLACK = [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
NEUTRAL = 0.5  # the "Specular IOR Level" that leaves the index of refraction unchanged
SHARP = 1e-3


Density = Callable[[int], tuple[float, float] | None]


def _unknown(_: int) -> None:
    return None


class Surfaces:
    """Exports the materials of one scene.

    primary: the names of the UV maps that are exported as the first one of their meshes.
    """

    def __init__(self, scene: Scene, primary: set[str]) -> None:
        self._scene, self._primary = scene, primary
        self.colors: dict[str, str] = {}  # material -> the colour attribute that it uses

    def add(self, material: Any, density: Density = _unknown) -> str:
        """Exports a bpy.types.Material unless it is exported already; returns its key.

        density: returns the surface's length per UV unit on the first mesh that uses the material, as for `Values.bumps`.
        """
        key = material.name_full
        if key not in self._scene.materials:
            made = Material(material.name, number=material.pass_index)
            self._scene.materials[key] = made
            made.gltf = _Reader(self._scene, material, self._primary, self.colors, density).read()
        return key


class _Reader:
    def __init__(self, scene: Scene, material: Any, primary: set[str], colors: dict[str, str], density: Density) -> None:
        self._density = density
        self._scene, self._source, self._colors = scene, material, colors
        self._name = material.name
        self._values = Values(scene, self._name, primary)
        self._pictures = Pictures(scene, self._name)
        self._said: dict[str, Any] = {"doubleSided": True}
        self._more: dict[str, Any] = {}  # extensions

    def read(self) -> dict[str, Any]:
        tree = self._source.node_tree if self._source.use_nodes else None
        if tree is None:
            self._pbr(list(self._source.diffuse_color)[:3], 0.0, 1.0)  # Cycles renders it as diffuse
            self._said["extensions"] = {"KHR_materials_specular": {"specularFactor": 0.0}}
            return self._said
        shader = output_of(tree)
        if shader is None:
            self._pbr(BLACK, 0.0, 1.0)
            self._extend("specular", specularFactor=0.0)
        else:
            self._shader(shader)
        inside = subsurface.filled(tree, self._transmits_light(), self._warn)
        if inside is not None:
            self._more[subsurface.MEDIUM] = inside
        self._displace(tree)
        warn_of_pictures(tree, self._warn)
        warn_of_material(self._source, self._warn)
        if self._more:
            self._said["extensions"] = self._more
        return self._said

    def _displace(self, tree: Any) -> None:
        heights = displaced(self._source, tree, getattr(self._density, "scale", 1.0), self._warn)
        if heights is None:
            return
        if heights.moves:
            self._move(heights)
            return
        if "normalTexture" in self._said:
            self._warn(
                Sentence(
                    "blend-displacement-and-normals", "its displacement is left out, since it has another bump or normal map"
                )
            )
            return
        found = self._values.bumps(heights, self._density)
        picture = None if found is None else self._pictures.image_use(found, False)
        if picture is None:
            self._warn(
                Sentence(
                    "blend-displacement-not-by-uvs",
                    "its displacement is left out; only that by UV-mapped images is shown",
                )
            )
            return
        self._said["normalTexture"] = replace(picture, strength=1.0)
        if (coat := self._more.get("KHR_materials_clearcoat")) is not None:
            coat.setdefault("clearcoatNormalTexture", replace(picture, strength=1.0))

    def _move(self, heights: Heights) -> None:
        """Exports displacement that moves the surface."""
        value = self._values.read(heights.input("Height"), 0.0, "height")
        numbers = heights.parameters(number(value.factor))
        picture = None
        if value.image is not None and numbers is not None:
            if value.inverted or value.channel not in (None, GREY, 0):
                picture = self._pictures.packed([(value, 0)], value, False)
            else:
                picture = self._pictures.image_use(value, False, deep=True)
        if picture is None or numbers is None:
            self._warn(
                Sentence("blend-displacement-not-by-uvs", "its displacement is left out; only that by UV-mapped images is shown")
            )
            return
        self._more[DISPLACEMENT] = {"displacementTexture": picture, **numbers}

    def _transmits_light(self) -> bool:
        """Returns True if light enters the material by transmission."""
        return self._more.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0) > 0

    def _warn(self, what: str) -> None:
        self._scene.warn(Sentence("blend-material", "Material {material}: {note}.", material=self._name, note=what))

    def _pbr(self, color: Any, metallic: float, roughness: float, alpha: float = 1.0) -> dict[str, Any]:
        rgb = [min(max(float(c), 0.0), 1.0) for c in color]
        found = {"baseColorFactor": [*rgb, alpha], "metallicFactor": metallic, "roughnessFactor": roughness}
        self._said["pbrMetallicRoughness"] = found
        return found

    def _extend(self, name: str, **fields: Any) -> None:
        self._more.setdefault(f"KHR_materials_{name}", {}).update(fields)

    def _shader(self, source: Source) -> None:
        read = {"BSDF_TRANSPARENT": self._transparent_shader, "MIX_SHADER": self._mix, "ADD_SHADER": self._sum}.get(
            source.node.type
        )
        if read is not None:
            read(source)
            return
        look = principled_look(source, self._warn)
        if look is not None:
            self._principled(look)
            return
        self._warn(
            Sentence(
                "blend-shader-grey",
                "its unsupported shader {shader} is shown as grey",
                shader=source.node.bl_label or source.node.type,
            )
        )
        self._pbr([0.8] * 3, 0.0, 1.0)

    def _principled(self, source: PrincipledLook) -> None:
        def value(default: Any, *names: str) -> Value:
            return self._values.read(source.input(*names), default, names[0].lower())

        color, metallic, roughness = value([0.8] * 3, "Base Color"), value(0.0, "Metallic"), value(0.5, "Roughness")
        alpha = value(1.0, "Alpha")
        self._base(color, alpha)
        self._metal_and_rough(metallic, roughness)
        transmission = value(0.0, "Transmission Weight", "Transmission")
        self._reflection(source, number(transmission.factor) > 0 or transmission.image is not None)
        if number(transmission.factor) > 0:
            self._extend("transmission", transmissionFactor=number(transmission.factor))
            self._slot(transmission, "KHR_materials_transmission", "transmissionTexture", 0)
            self._interior()
        self._coat(value, source)
        self._sheen(source)
        self._translucent(value)
        self._emission(source)
        self._anisotropy(source, number(roughness.factor))
        self._film(source)
        self._normal(source.input("Normal"), self._said, "normalTexture")
        if (beneath := subsurface.subsurface(source)) is not None:
            self._more[subsurface.SUBSURFACE] = beneath
        if (hair := fibres.hair(source)) is not None:
            self._more[fibres.HAIR] = hair
        if _is_some(source.input("Diffuse Roughness")):
            self._warn(Sentence("blend-diffuse-roughness-left-out", "its diffuse roughness is left out"))

    def _base(self, color: Value, alpha: Value) -> None:
        opacity = min(max(number(alpha.factor), 0.0), 1.0)
        found = self._pbr(as_list(color.factor), 0.0, 1.0, opacity)
        if color.vertex is not None or alpha.vertex is not None:
            name = color.vertex if color.vertex is not None else alpha.vertex
            self._colors[self._source.name_full] = name or ""
        if alpha.image is not None and (color.image is None or alpha.image != color.image or alpha.channel != 3):
            told = color if color.image is not None else alpha
            picture = self._pictures.packed([(color, 0), (color, 1), (color, 2), (alpha, 3)], told, True)
        else:
            picture = None if color.image is None else self._pictures.image_use(color, True)
        if picture is not None:
            found["baseColorTexture"] = picture
        if opacity < 1 or alpha.image is not None:
            self._said["alphaMode"] = "BLEND"

    def _metal_and_rough(self, metallic: Value, roughness: Value) -> None:
        found = self._said["pbrMetallicRoughness"]
        found["metallicFactor"] = min(max(number(metallic.factor), 0.0), 1.0)
        found["roughnessFactor"] = min(max(number(roughness.factor), 0.0), 1.0)
        if metallic.image is None and roughness.image is None:
            return
        told = roughness if roughness.image is not None else metallic
        is_packed = all(
            each.image is None or (each.image == told.image and each.channel == channel and not each.inverted)
            for each, channel in ((roughness, 1), (metallic, 2))
        )
        # A value without an image must not be scaled by the other's factor.
        is_packed = is_packed and roughness.image is not None and metallic.image is not None
        if is_packed:
            picture = self._pictures.image_use(told, False)
        else:
            picture = self._pictures.packed([(None, 0), (roughness, 1), (metallic, 2)], told, False)
        if picture is not None:
            found["metallicRoughnessTexture"] = picture

    def _reflection(self, source: PrincipledLook, transmits: bool) -> None:
        """Exports the specular level as an index of refraction, since in Cycles it scales the reflectance at normal incidence."""
        ior = number(constant_value(source.input("IOR")) or 1.5)
        level = self._values.read(source.input("Specular IOR Level", "Specular"), NEUTRAL, "specular level")
        factor = number(level.factor) / NEUTRAL if level.image is None else 1.0
        if level.image is not None:
            self._warn(Sentence("blend-specular-level-image", "the image of its specular level is left out"))
        if transmits:
            if abs(factor - 1) > 1e-3:
                self._extend("specular", specularFactor=min(factor, 1.0))
        elif factor < 1e-3:
            self._extend("specular", specularFactor=0.0)
        elif abs(factor - 1) > 1e-3:
            f0 = min(((ior - 1) / (ior + 1)) ** 2 * factor, 0.98)
            ior = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))
        if abs(ior - 1.5) > 1e-4:
            self._extend("ior", ior=max(ior, 1.0))
        tint = self._values.read(source.input("Specular Tint"), WHITE, "specular tint")
        if isinstance(tint.factor, list) and tint.factor != WHITE:
            self._extend("specular", specularColorFactor=tint.factor)
        if tint.image is not None:
            self._slot(tint, "KHR_materials_specular", "specularColorTexture", None, as_color=True)

    def _interior(self) -> None:
        # Cycles refracts at every surface; the thickness requests that for open meshes too.
        self._extend("volume", thicknessFactor=1.0)

    def _coat(self, value: Any, source: PrincipledLook) -> None:
        coat = value(0.0, "Coat Weight", "Clearcoat")
        if number(coat.factor) <= 0:
            return
        rough = value(0.03, "Coat Roughness", "Clearcoat Roughness")
        self._extend("clearcoat", clearcoatFactor=min(number(coat.factor), 1.0), clearcoatRoughnessFactor=number(rough.factor))
        self._slot(coat, "KHR_materials_clearcoat", "clearcoatTexture", 0)
        self._slot(rough, "KHR_materials_clearcoat", "clearcoatRoughnessTexture", 1)
        self._normal(source.input("Coat Normal"), self._more["KHR_materials_clearcoat"], "clearcoatNormalTexture")
        left = under_coat(source)
        if left is not None:
            factor = self._said["pbrMetallicRoughness"]["baseColorFactor"]
            factor[:3] = [c * share for c, share in zip(factor[:3], left, strict=True)]

    def _sheen(self, source: PrincipledLook) -> None:
        weight = source.input("Sheen Weight", "Sheen")
        if weight is None or constant_value(weight) == 0.0:
            return
        tint, rough = source.input("Sheen Tint"), self._values.read(source.input("Sheen Roughness"), 0.5, "sheen roughness")
        color = self._values.read(weight if tint is None else Product(tint, weight), WHITE, "sheen")
        factor = [min(max(c, 0.0), 1.0) for c in as_list(color.factor)]
        self._extend("sheen", sheenColorFactor=factor, sheenRoughnessFactor=number(rough.factor))
        self._slot(color, "KHR_materials_sheen", "sheenColorTexture", None, as_color=True)
        self._slot(rough, "KHR_materials_sheen", "sheenRoughnessTexture", 3)

    def _emission(self, source: PrincipledLook) -> None:
        color, strength = source.input("Emission Color", "Emission"), source.input("Emission Strength")
        plain = constant_value(strength)
        if plain is None and strength is not None:  # the strength's nodes are evaluated in the image
            shines = self._values.read(Product(color, strength), [0.0] * 3, "emission")
            plain = 1.0 if shines.image is None else shines.image.scale_down()
        else:
            shines = self._values.read(color, [0.0] * 3, "emission color")
        light = [max(c * number(plain or 0.0), 0.0) for c in as_list(shines.factor)]
        if max(light) <= 0:
            return
        most = max(1.0, *light)
        self._said["emissiveFactor"] = [c / most for c in light]
        if most > 1:
            self._extend("emissive_strength", emissiveStrength=most)
        if shines.image is not None:
            picture = self._pictures.image_use(shines, True)
            if picture is not None:
                self._said["emissiveTexture"] = picture

    def _anisotropy(self, source: PrincipledLook, roughness: float) -> None:
        strength, turns = constant_value(source.input("Anisotropic")), constant_value(source.input("Anisotropic Rotation"))
        if not strength or strength <= 0:
            return
        rough, stretched = brushed(strength, roughness, turns or 0.0)
        self._said["pbrMetallicRoughness"]["roughnessFactor"] = rough
        self._extend("anisotropy", **stretched)

    def _film(self, source: PrincipledLook) -> None:
        thickness = constant_value(source.input("Thin Film Thickness"))
        if thickness and has_film(source):
            ior = constant_value(source.input("Thin Film IOR")) or 1.33
            ends = {"iridescenceThicknessMinimum": thickness, "iridescenceThicknessMaximum": thickness}
            self._extend("iridescence", iridescenceFactor=1.0, iridescenceIor=ior, **ends)

    def _normal(self, socket: SocketInGroups | None, owner: dict[str, Any], name: str) -> None:
        source, _ = source_of(socket)
        if source is None:
            return
        if source.node.type == "BUMP":
            found = self._values.bumps(source, self._density)
            picture = None if found is None else self._pictures.image_use(found, False)
            if picture is None:
                self._warn(
                    Sentence(
                        "blend-bumps-left-out", "its bumps are left out; only UV-mapped images and normal maps are supported"
                    )
                )
            else:
                owner[name] = replace(picture, strength=1.0)
            if source_of(source.input("Normal"))[0] is not None:
                self._warn(Sentence("blend-last-normals", "of its chained normal inputs, only the last is used"))
            return
        if source.node.type != "NORMAL_MAP" or source.node.space != "TANGENT":
            self._warn(
                Sentence(
                    "blend-normals-left-out",
                    "its normals are left out; only bumps and normal maps in tangent space are supported",
                )
            )
            return
        strength = constant_value(source.input("Strength"))
        found = self._values.read(source.input("Color"), WHITE, "normal map")
        if found.image is not None:
            picture = self._pictures.image_use(found, False)
            if picture is not None:
                owner[name] = replace(picture, strength=1.0 if strength is None else strength)

    def _transparent_shader(self, source: Source) -> None:
        color = self._values.read(source.input("Color"), WHITE, "colour")
        if min(as_list(color.factor)) < 1 - SHARP or color.image is not None:
            self._pbr(as_list(color.factor), 0.0, 0.0)
            self._extend("transmission", transmissionFactor=1.0)
            self._extend("ior", ior=1.0)
            return
        self._pbr(WHITE, 0.0, 1.0, 0.0)
        self._said["alphaMode"] = "BLEND"

    def _translucent(self, value: Any) -> None:
        weight = value(0.0, "Translucent Weight")
        if number(weight.factor) <= 0:
            return
        if weight.image is not None:
            self._warn(Sentence("blend-transmission-image", "the image of its transmission weight is left out"))
        color = value([0.8] * 3, "Translucent Color")
        said = {"diffuseTransmissionFactor": min(number(weight.factor), 1.0)}
        self._extend("diffuse_transmission", **said, diffuseTransmissionColorFactor=as_list(color.factor))
        self._slot(color, "KHR_materials_diffuse_transmission", "diffuseTransmissionColorTexture", None, as_color=True)

    def _mix(self, source: Source) -> None:
        """Exports a Mix Shader.

        A mix with a Transparent BSDF becomes alpha, a mix whose factor depends on the kind of ray becomes the shader of camera
        rays, and any other mix a single principled look.
        """
        if (which := input_for_camera_rays(source.input_at(0))) is not None:
            self._warn(Sentence("cycles-light-path-mix", "of shaders mixed by Light Path, all rays see the one for the camera"))
            shown = source_of(source.input_at(1 + which))[0]
            if shown is not None:
                self._shader(shown)
            return
        first, second = (source_of(source.input_at(i))[0] for i in (1, 2))
        clear = [each is not None and each.node.type == "BSDF_TRANSPARENT" for each in (first, second)]
        if clear[0] != clear[1]:
            solid = second if clear[0] else first
            if solid is not None:
                share = self._values.read(source.input_at(0), 0.5, "mix")
                self._shader(solid)
                self._make_transparent(share if clear[0] else one_minus(share))
                return
        look = principled_look(source, self._warn)
        if look is not None:
            self._principled(look)

    def _make_transparent(self, opacity: Value) -> None:
        found = self._said.get("pbrMetallicRoughness")
        if found is None:
            return
        found["baseColorFactor"][3] *= min(max(number(opacity.factor), 0.0), 1.0)
        self._said["alphaMode"] = "BLEND"
        if opacity.image is None:
            return
        under: TextureUse | None = found.get("baseColorTexture")
        if under is not None and opacity.channel == 3 and under.image == self._pictures.name(opacity, True):
            return  # the alpha of the same image
        if under is not None:
            self._warn(Sentence("blend-transparency-mix-image", "the image of its mix with transparency is left out"))
            return
        white = Value(WHITE)
        picture = self._pictures.packed([(white, 0), (white, 1), (white, 2), (opacity, 3)], opacity, True)
        if picture is not None:
            found["baseColorTexture"] = picture

    def _sum(self, source: Source) -> None:
        """Exports an Add Shader. Added to a Transparent BSDF, a shader becomes half transparent, with a warning."""
        parts = [source_of(source.input_at(i))[0] for i in (0, 1)]
        clear = [each is not None and each.node.type == "BSDF_TRANSPARENT" for each in parts]
        if any(clear):
            self._warn(Sentence("cycles-transparency-half", "shaders added to its transparency hide half of the background"))
            solid = parts[1] if clear[0] else parts[0]
            if solid is not None and not all(clear):
                self._shader(solid)
                self._make_transparent(Value(0.5))
            return
        look = principled_look(source, self._warn)
        if look is not None:
            self._principled(look)

    def _slot(self, value: Value, extension: str, name: str, channel: int | None, as_color: bool = False) -> None:
        """Adds a value's image to a glTF extension as the texture `name`, in the channel that glTF reads."""
        if value.image is None:
            return
        if channel is None or (value.channel == channel and not value.inverted):
            picture = self._pictures.image_use(value, as_color)
        else:
            picture = self._pictures.packed([(value, channel)], value, as_color)
        if picture is not None:
            self._more.setdefault(extension, {})[name] = picture


def _is_some(socket: SocketInGroups | None) -> bool:
    if socket is None:
        return False
    plain = constant_value(socket)
    return plain is None or number(plain) > SHARP
