"""Reads glTF materials: metallic-roughness, alpha and emission (specification 3.9); extensions.py reads the extensions.

Occlusion textures are ignored, since path tracing computes occlusion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from renderer.bvh.layout import RAY_KINDS
from renderer.scene.material import AlphaMode, Material, with_visibility
from renderer.scene.readers.gltf import extensions, scattering
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.specular_glossiness import read_specular_glossiness
from renderer.scene.readers.gltf.textures import UV_SETS, Textures, uv_sets_of
from renderer.scene.readers.number_ranges import clamped
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["EXTENSIONS", "MATTES", "Materials", "NodeLook"]

MATTES = ("holdout", "shadow_catcher", "reflection_catcher")  # in the extras of nodes and materials

EXTENSIONS = {"KHR_materials_emissive_strength", "KHR_materials_pbrSpecularGlossiness", *extensions.NAMES, *scattering.NAMES}

_ALPHA_MODES: dict[str, AlphaMode] = {"OPAQUE": "opaque", "MASK": "mask", "BLEND": "blend"}


class NodeLook(NamedTuple):
    """Material properties that a node overrides for its meshes. Of names, empty ones keep the material's."""

    hidden_from: tuple[str, ...]  # the kinds of rays that do not see it (RAY_KINDS)
    holdout: bool
    shadow_catcher: bool
    reflection_catcher: bool
    light_group: str
    light_link: str
    shadow_link: str


class Materials:
    """The materials of one file, appended to the description's list."""

    def __init__(self, root: Json, textures: Textures, shelf: TextureShelf, materials: list[Material]) -> None:
        self._textures, self._shelf, self._materials = textures, shelf, materials
        self.sources = root.objects("materials")
        self._first = len(materials)
        self._panes: dict[int, int] = {}
        self._passed: dict[tuple[int, NodeLook], int] = {}
        self._default: int | None = None
        self._filled: list[bool] = []
        self._uv_sets = [uv_sets_of(source.value) for source in self.sources]
        for i, source in enumerate(self.sources):
            textures.uv_sets = self._uv_sets[i]
            materials.append(self._read(source, source.text("name", "") or f"material {i}"))
            self._filled.append(extensions.has_thickness(source))

    def number(self, index: int | None) -> int:
        """Returns the index, in the scene description, of one of the file's materials; None: the default material (3.7.2.1)."""
        if index is not None:
            return self._first + index
        if self._default is None:
            self._materials.append(_standard("glTF default"))
            self._default = len(self._materials) - 1
        return self._default

    def uv_sets(self, index: int | None) -> tuple[int, ...]:
        """Returns the numbers of the file's UV sets that meshes with this material need."""
        return UV_SETS if index is None else self._uv_sets[index]

    def depends_on_mesh(self, index: int | None) -> bool:
        """Returns True if the material transmits light and has no thickness; it is then thin unless its mesh is closed."""
        return index is not None and self._materials[self._first + index].transmission > 0 and not self._filled[index]

    def aspect_ratio(self, index: int | None) -> float:
        """Returns the aspect ratio of hair; 1 for other materials."""
        return 1.0 if index is None else self._materials[self._first + index].aspect_ratio

    def thin_material(self, index: int) -> int:
        """Returns the index, in the scene description, of the material as a thin sheet, for meshes that are not closed."""
        if index not in self._panes:
            self._materials.append(replace(self._materials[self._first + index], thin=True))
            self._panes[index] = len(self._materials) - 1
        return self._panes[index]

    def of_node(self, number: int, look: NodeLook) -> int:
        """Returns the index of a copy of a material with the properties of a node."""
        key = number, look
        if key not in self._passed:
            source = self._materials[number]
            changed = replace(
                with_visibility(source, {kind: kind not in look.hidden_from for kind in RAY_KINDS}),
                holdout=look.holdout or source.holdout,
                shadow_catcher=look.shadow_catcher or source.shadow_catcher,
                reflection_catcher=look.reflection_catcher or source.reflection_catcher,
                light_group=look.light_group or source.light_group,
                light_link=look.light_link or source.light_link,
                shadow_link=look.shadow_link or source.shadow_link,
            )
            self._materials.append(changed)
            self._passed[key] = len(self._materials) - 1
        return self._passed[key]

    def _read(self, source: Json, name: str) -> Material:
        material = _standard(name)
        glossy = source.extension("KHR_materials_pbrSpecularGlossiness")
        if glossy:
            read_specular_glossiness(glossy, material, self._textures, self._shelf)
        elif (metallic_roughness := source.object(extensions.METALLIC_ROUGHNESS)) is not None:
            values = metallic_roughness.vector("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
            r, g, b, material.opacity = (metallic_roughness.clamped("baseColorFactor", value, 0.0, 1.0) for value in values)
            material.base_color = (r, g, b)
        extensions.read_parameters(source, material, self._textures, metallic_roughness=not glossy)
        material.light_group, material.light_link = (source.name_in_extras(key) for key in ("light_group", "light_link"))
        material.shadow_link = source.name_in_extras("shadow_link")
        material.holdout, material.shadow_catcher, material.reflection_catcher = (source.flag_in_extras(key) for key in MATTES)
        self._alpha_mode(source, material)
        self._emission(source, material)
        extensions.read_extensions(source, material)
        scattering.read_scatter(source, material, self._textures, self._shelf, is_thin=not extensions.has_thickness(source))
        return material

    def _alpha_mode(self, source: Json, material: Material) -> None:
        mode = source.text("alphaMode", "OPAQUE")
        if mode not in _ALPHA_MODES:
            source.fault(
                "alphaMode",
                Sentence("value-unknown", "is {value}; known are {choices}", value=repr(mode[:20]), choices=[*_ALPHA_MODES]),
            )
        material.alpha_mode = _ALPHA_MODES.get(mode, "opaque")

    def _emission(self, source: Json, material: Material) -> None:
        extension = source.extension("KHR_materials_emissive_strength")
        strength = extension.number("emissiveStrength", 1.0) if extension else 1.0
        r, g, b = (clamped(c * strength, 0.0, 1e9) for c in source.vector("emissiveFactor", (0.0, 0.0, 0.0)))
        material.emission = (r, g, b)
        if max(material.emission) > 0:
            material.emission_texture = self._textures.find(source, "emissiveTexture", material.name, srgb=True)
            if material.emission_texture is None and "emissiveTexture" in source:
                material.emission = (0.0, 0.0, 0.0)  # without its texture the whole surface would emit


def _standard(name: str) -> Material:
    # The specification's defaults, including metallic 1.
    return Material(name, "metallic_roughness", (1.0, 1.0, 1.0), metallic=1.0, roughness=1.0)
