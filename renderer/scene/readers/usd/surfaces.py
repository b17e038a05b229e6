"""Converts the materials bound to a stage's prims to materials of the description."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from renderer.scene.material import Material
from renderer.scene.readers.number_ranges import unit_color
from renderer.scene.readers.usd import primvars
from renderer.scene.readers.usd.displacement import read_displacement
from renderer.scene.readers.usd.hair import is_hair, read_hair
from renderer.scene.readers.usd.materialx import SURFACES, read_materialx
from renderer.scene.readers.usd.network import Network
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.omni_pbr import NAMES as OMNI_PBR
from renderer.scene.readers.usd.omni_pbr import read_omni_pbr
from renderer.scene.readers.usd.preview_surface import Read, read_preview_surface
from renderer.scene.readers.usd.textures import Images
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["Surface", "Surfaces"]

_COLOR_PRIMVARS = ("displayColor", "Cd")  # Cd: Houdini's own name
_VARIES = "varies"
_SURFACE, _MDL = "surface", "mdl"
_CONTEXTS = ("mtlx", "", "kma", "arnold", _MDL)  # render contexts in order of preference; "" is the universal one


class Surface(NamedTuple):
    """A material of the description, and the names of the primvars that it uses for UVs, colour and opacity."""

    number: int
    uvs: tuple[str, ...] = ()
    color: str | None = None
    opacity: str | None = None


class Surfaces:
    """The materials of a stage, each read when a prim first uses it."""

    def __init__(
        self, images: Images, shelf: TextureShelf, materials: list[Material], notes: Notes, time: Any, unit: float
    ) -> None:
        self._images, self._shelf, self._materials, self._notes, self._time = images, shelf, materials, notes, time
        self._unit = unit
        self._known: dict[Any, Any] = {}
        self._asked: dict[Any, tuple[str, ...]] = {}  # primvars that a material reads, except UVs

    def surface_of(self, material: Any, prim: Any) -> Surface:
        """Returns the surface of a prim. material: its bound material; if None or unsupported, the display colour is used."""
        if not material:
            return self._display_color_surface(prim)
        source = material.GetPrim()
        key = (source.GetPrimInPrototype() if source.IsInstanceProxy() else source).GetPath()
        if key not in self._asked:
            self._read_cached(key, material, prim)
        states = tuple(self._primvar_state(prim, name) for name in self._asked[key])
        if (key, states) not in self._known:
            self._read_cached(key, material, prim)
        return self._known.get((key, states)) or self._display_color_surface(prim)

    def _read_cached(self, key: Any, material: Any, prim: Any) -> None:
        """Converts a material for a prim, and caches the result.

        It is used for all prims on which the primvars that the material reads have the same values.
        """
        found, self._asked[key] = self._read(material, prim)
        self._known[key, tuple(self._primvar_state(prim, name) for name in self._asked[key])] = found

    def _primvar_state(self, prim: Any, name: str) -> Any:
        """Returns None if a prim lacks a primvar, its value if it is constant, or a marker if it varies over the surface."""
        if primvars.find_primvar(prim, name) is None:
            return None
        value = primvars.constant_value(prim, name, self._time)
        return _VARIES if value is None else value

    def with_parameters(self, surface: Surface, key: str, **values: Any) -> Surface:
        """Returns a copy of a surface with other material parameters, cached by key."""
        if (surface.number, key) not in self._known:
            made = self._add(replace(self._materials[surface.number], **values), surface)
            self._known[surface.number, key] = made
        return self._known[surface.number, key]

    def material(self, surface: Surface) -> Material:
        """Returns the Material, in the scene description, to which a surface refers."""
        return self._materials[surface.number]

    def add(self, material: Material) -> Surface:
        """Adds a material that is not bound to a prim; returns its surface."""
        return self._add(material, Surface(0))

    def _add(self, material: Material, like: Surface) -> Surface:
        self._materials.append(material)
        return like._replace(number=len(self._materials) - 1)

    def _display_color_surface(self, prim: Any) -> Surface:
        """Returns a diffuse surface with a prim's display colour and opacity, for prims without a material."""
        shown = next((name for name in _COLOR_PRIMVARS if primvars.find_primvar(prim, name) is not None), _COLOR_PRIMVARS[0])
        color, opacity = (primvars.constant(prim, name, n, self._time) for name, n in ((shown, 3), ("displayOpacity", 1)))
        varying = [
            None if c is not None or primvars.find_primvar(prim, n) is None else n
            for c, n in ((color, shown), (opacity, "displayOpacity"))
        ]
        clear = 1.0 if opacity is None else float(unit_color([opacity[0]] * 3)[0])
        key = ("shown", None if color is None else tuple(map(float, color)), clear, *varying)
        if key not in self._known:
            own = (0.8, 0.8, 0.8) if varying[0] is None else (1.0, 1.0, 1.0)
            material = Material("displayColor" if color is not None or varying[0] else "default")
            material.base_color = own if color is None else unit_color(map(float, color))
            material.opacity = clear
            if clear < 1 or varying[1]:
                material.alpha_mode = "blend"
            self._known[key] = self._add(material, Surface(0, (), varying[0], varying[1]))
        return self._known[key]

    def _read(self, material: Any, prim: Any) -> tuple[Surface | None, tuple[str, ...]]:
        name = material.GetPrim().GetName()
        network = Network(self._images, self._notes, self._time, name, prim, self._unit)
        read = Read(name, network, self._shelf)
        shader, kind = _surface(material)
        if kind == "UsdPreviewSurface":
            read_preview_surface(shader, read)
        elif kind in SURFACES:
            read_materialx(shader, kind, read)
        elif kind in OMNI_PBR:
            read_omni_pbr(shader, read)
        elif shader is not None:
            read_hair(shader, kind, read)
        else:
            self._notes.add(
                Sentence(
                    "usd-surface-unknown",
                    "Materials with an unknown surface shader ({surface}) are drawn in the display colour",
                    surface=kind,
                )
                if kind
                else Sentence("usd-surface-missing", "Materials without a surface shader are drawn in the display colour"),
                name,
            )
            return None, ()
        if any(self._primvar_state(prim, each) is _VARIES for each in network.asked if each not in (read.color, read.opacity)):
            self._notes.add(
                Sentence(
                    "usd-primvar-inputs-fallback",
                    "Varying primvars are supported for colours and opacities only; others use their fallback",
                ),
                name,
            )
        read_displacement(material, shader, read)
        if material.ComputeVolumeSource()[0]:
            self._notes.add(Sentence("usd-volumes-ignored", "Volumes inside of materials are not drawn"), name)
        found = self._add(read.material, Surface(0, tuple(network.uvs), read.color, read.opacity))
        return found, tuple(network.asked)


def _surface(material: Any) -> tuple[Any, str]:
    """Returns a material's surface shader and the shader's kind.

    If the material has shaders for several render contexts, the one of the preferred context is returned.
    """
    found = ""
    outputs = {
        str(output.GetBaseName()).removesuffix(_SURFACE).removesuffix(":"): output for output in material.GetSurfaceOutputs()
    }
    last = len(_CONTEXTS)
    for context in sorted(outputs, key=lambda name: _CONTEXTS.index(name) if name in _CONTEXTS else last):
        shader = material.ComputeSurfaceSource(context)[0]
        if not shader:
            continue
        kind = str(shader.GetIdAttr().Get() or "")
        if kind == "UsdPreviewSurface" or kind in SURFACES or is_hair(shader, kind):
            return shader, kind
        if context == _MDL:
            kind = str(shader.GetSourceAssetSubIdentifier(_MDL) or "")
            if kind in OMNI_PBR:
                return shader, kind
        found = found or kind
    return None, found or ", ".join(name for name, output in outputs.items() if output.HasConnectedSource())
