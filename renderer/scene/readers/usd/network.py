"""Resolves the inputs of a surface shader through the primvar readers, transforms and textures of its network."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Sdf, UsdShade

from renderer.scene.description import UvTransform
from renderer.scene.readers.usd import primvars
from renderer.scene.readers.usd.arnold import PREFIX as ARNOLD
from renderer.scene.readers.usd.arnold import follow_arnold
from renderer.scene.readers.usd.inputs import Input
from renderer.scene.readers.usd.nodes import follow_coordinates, follow_node
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.textures import PLAIN, Four, Images, TextureInput, color_space, composed_transform, transform_2d
from renderer.scene.textures import IDENTITY_UV_TRANSFORM
from renderer.sentences import Sentence

__all__ = ["Network"]

MAX_DEPTH = 32
_NOTHING = Input()
_COLORS = (Sdf.ValueTypeNames.Color3f, Sdf.ValueTypeNames.Color4f)
_UV_SETS = 2
_ODD = (TypeError, ValueError, IndexError, OverflowError)  # values of wrong types or lengths
_WRONG_TYPES = Sentence("usd-materialx-input-types-wrong", "MaterialX nodes whose inputs have wrong types are left out")


@dataclass
class Network:
    """The shader network of one material as bound to one prim.

    uvs: names of the primvars that its textures use as UV sets, two at most; asked: names of the other primvars that were read;
    unit: metres per stage unit.
    """

    images: Images
    notes: Notes
    time: Any
    user: str
    prim: Any = None
    unit: float = 1.0
    uvs: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    _surface: Any = None  # the last shader, whose inputs are cached
    _inputs: dict[str, Any] = field(default_factory=dict)

    def input(self, shader: Any, name: str, srgb: bool = False) -> Input:
        """Returns an input of a shader, empty if it is not set.

        srgb: whether its texture is sRGB-encoded if the file does not specify.
        """
        prim = shader.GetPrim()
        if prim != self._surface:
            self._surface = prim
            self._inputs = {str(each.GetBaseName()): each for each in shader.GetInputs()}
        source = self._inputs.get(name)
        return _NOTHING if source is None else self._follow(source, srgb, 0)

    def _follow(self, source: Any, srgb: bool, depth: int) -> Input:
        if not source or depth > MAX_DEPTH:
            return Input()
        found = source.GetValueProducingAttributes()
        if not found:
            return Input()
        if UsdShade.Utils.GetType(found[0].GetName()) == UsdShade.AttributeType.Input:
            return Input(self._constant(found[0]))
        shader = UsdShade.Shader(found[0].GetPrim())
        kind = str(shader.GetIdAttr().Get() or "")
        output = UsdShade.Output(found[0]).GetBaseName()
        if kind == "UsdUVTexture":
            return self._uv_texture(shader, output, srgb, depth)
        if kind.startswith("UsdPrimvarReader"):
            fallback = self._follow(shader.GetInput("fallback"), srgb, depth + 1).value
            return self.primvar(self._varname(shader, depth), _zero(kind) if fallback is None else fallback)
        if kind.startswith("ND_"):
            try:
                return follow_node(self, shader, kind, output, srgb, depth, self._follow)
            except _ODD:
                self.notes.add(_WRONG_TYPES, kind)
                return Input()
        if kind.startswith(ARNOLD):
            return follow_arnold(self, shader, kind, output, srgb, depth, self._follow)
        self.notes.add(
            Sentence("usd-shaders-unknown", "Unknown shaders are left out"),
            kind or Sentence("usd-shader-without-kind", "without an identifier"),
        )
        return Input()

    def _constant(self, attribute: Any) -> Any:
        """Returns the value of an input; a colour whose attribute names a colour space as linear Rec.709."""
        value = attribute.Get(self.time)
        space = color_space(attribute)
        if not space or attribute.GetTypeName() not in _COLORS or value is None:
            return value
        colors = self.images.shelf.colors
        rgb = colors.linear(np.array(value)[:3], colors.encoding(self.user, "srgb" in space.lower(), space))
        return type(value)(*map(float, rgb), *value[3:])

    def primvar(self, name: str | None, fallback: Any) -> Input:
        """Returns a primvar of the prim: its value if constant, its name if it varies over the surface.

        Returns the fallback if the prim lacks the primvar.
        """
        if not name:
            return Input(fallback)
        if name not in self.asked:
            self.asked.append(name)
        if primvars.find_primvar(self.prim, name) is None:
            return Input(fallback)
        value = primvars.constant_value(self.prim, name, self.time)
        return Input(fallback, None, name) if value is None else Input(value)

    def _varname(self, shader: Any, depth: int) -> str | None:
        name = self._follow(shader.GetInput("varname"), False, depth + 1).value
        return str(name) if name else None

    def _uv_texture(self, shader: Any, output: str, srgb: bool, depth: int) -> Input:
        def constant_input(name: str, default: Any) -> Any:
            value = self._follow(shader.GetInput(name), False, depth + 1).value
            return default if value is None else value

        file = shader.GetInput("file")
        found: list[Any] = file.GetValueProducingAttributes() if file else []
        space = str(constant_input("sourceColorSpace", "auto"))
        if space == "auto":
            space = color_space(found[0]) if found and srgb else ""
        user = Sentence("label-material", "Material {name}", name=self.user)
        image = self.images.find(found[0], user, srgb, self.time, space=space) if found else None
        if image is None:
            # No file: black. Missing file: the fallback if authored, otherwise the input's default.
            fallback = constant_input("fallback", None if found else (0.0, 0.0, 0.0, 1.0))
            if fallback is None:
                return Input()
            values = _four(fallback, PLAIN[1])
            return Input(values["rgba".index(output)] if output in ("r", "g", "b", "a") else values[:3])
        number, tiles = image
        uv_set, transform = self.coordinates(shader.GetInput("st"), depth + 1)
        wraps = str(constant_input("wrapS", "useMetadata")), str(constant_input("wrapT", "useMetadata"))
        texture = self.images.texture(number, wraps, uv_set, composed_transform(transform, tiles), self.user)
        scale, bias = (_four(constant_input(name, plain), plain) for name, plain in zip(("scale", "bias"), PLAIN, strict=True))
        return Input(None, None if texture is None else TextureInput(texture, output, scale, bias))

    def coordinates(self, source: Any, depth: int) -> tuple[int, UvTransform]:
        """Returns the UV set of a texture, and the transform applied to its UVs."""
        transform = IDENTITY_UV_TRANSFORM
        while source and depth < MAX_DEPTH:
            depth += 1
            found = source.GetValueProducingAttributes()
            if not found or UsdShade.Utils.GetType(found[0].GetName()) == UsdShade.AttributeType.Input:
                break
            shader = UsdShade.Shader(found[0].GetPrim())
            kind = str(shader.GetIdAttr().Get() or "")
            if kind == "UsdTransform2d":
                transform = composed_transform(self._transform(shader, depth), transform)
                source = shader.GetInput("in")
                continue
            if kind.startswith("UsdPrimvarReader"):
                return self.uv_set(self._varname(shader, depth) or "st"), transform
            if kind.startswith("ND_"):
                try:
                    name, moved, source = follow_coordinates(self, shader, kind, depth, self._follow)
                except _ODD:
                    self.notes.add(_WRONG_TYPES, kind)
                    break
                transform = composed_transform(moved, transform)
                if name is not None:
                    return self.uv_set(name), transform
                continue
            self.notes.add(
                Sentence("usd-shaders-unknown", "Unknown shaders are left out"),
                kind or Sentence("usd-shader-without-kind", "without an identifier"),
            )
            break
        return self.uv_set("st"), transform

    def _transform(self, shader: Any, depth: int) -> UvTransform:
        def constant_input(name: str, default: Any) -> Any:
            value = self._follow(shader.GetInput(name), False, depth + 1).value
            return default if value is None else value

        scale, translation = (
            tuple(float(v) for v in constant_input(n, d)) for n, d in (("scale", (1, 1)), ("translation", (0, 0)))
        )
        return transform_2d((scale[0], scale[1]), float(constant_input("rotation", 0.0)), (translation[0], translation[1]))

    def uv_set(self, name: str) -> int:
        """Returns the index of the UV set whose primvar has this name; 0, with a note, if there are already two other sets."""
        if name not in self.uvs:
            if len(self.uvs) == _UV_SETS:
                self.notes.add(
                    Sentence(
                        "usd-uv-sets-too-many",
                        "Materials with more than two UV sets use the first in place of the others",
                    ),
                    self.user,
                )
                return 0
            self.uvs.append(name)
        return self.uvs.index(name)


def _zero(kind: str) -> Any:
    """Returns the value of a primvar reader whose primvar and fallback are missing: 0 for scalars, otherwise (0, 0, 0).

    kind: the reader's node definition.
    """
    return 0.0 if kind.endswith(("float", "int")) else (0.0, 0.0, 0.0)


def _four(values: Any, default: Four) -> Four:
    found = tuple(float(v) for v in values)
    return (found[0], found[1], found[2], found[3]) if len(found) == 4 else default
