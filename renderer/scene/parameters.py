"""Declares each parameter of a material once: type, range, table column, and names in file formats.

renderer/scene/material.py has the table. It is used to check and pack scenes, to find a parameter's field in a file, and to
generate the scene file's schema (renderer/scene/readers/yaml/schema.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from renderer.arrays.rows import KINDS
from renderer.sentences import Sentence
from renderer.setting_declaration import MAX_NAME, is_name

__all__ = [
    "EVERY_KIND",
    "PRINCIPLED",
    "SCATTERED_RAYS",
    "SURFACES",
    "MaterialKind",
    "Parameter",
    "choice_parameter",
    "color",
    "flag_parameter",
    "name_parameter",
    "number",
    "parameters_of",
    "texture",
    "values",
]

MaterialKind = str  # the name of one of `EVERY_KIND`

Form = Literal["number", "flag", "choice", "color", "radiance", "triple", "pair", "degrees", "texture", "name"]

PRINCIPLED: tuple[str, ...] = ("metallic_roughness",)
EVERY_KIND: tuple[str, ...] = tuple(kind.name for kind in KINDS if kind.in_files)
SURFACES: tuple[str, ...] = tuple(kind for kind in EVERY_KIND if kind != "interface")  # the visible kinds

SCATTERED_RAYS: tuple[str, ...] = ("diffuse", "glossy", "transmission", "volume")  # the kinds of rays that leave vertices

_KEY = "parameter"


@dataclass(frozen=True)
class Parameter:
    """A declared material parameter: its range, its column in the material table, and its names in file formats.

    column, slot: index in `material` or `material_texture` (renderer/arrays/rows.py); None if packing does more than copy it.
    kinds: the material kinds that use it. in_file: its name in scene files. gltf: its path in a glTF material, through objects
    and extensions, if the reader only copies it. mtl: its name in MTL files, if the reader only copies it.
    """

    name: str
    form: Form
    default: Any
    kinds: tuple[str, ...]
    in_file: str
    column: int | None = None
    slot: int | None = None
    low: float = -math.inf
    high: float = math.inf
    above: bool = False  # whether `low` itself is excluded
    choices: tuple[str, ...] = ()
    gltf: str | None = None
    mtl: str | None = None
    srgb: bool = False  # for textures: whether their colours are sRGB-encoded
    layered: bool = True  # for textures: whether the slot supports layers

    def clamped(self, value: float) -> float:
        """Returns the number clamped to the parameter's range."""
        return min(max(value, self.low), self.high)

    def fault(self, value: Any) -> str | None:
        """Returns what is wrong with a value, worded as the end of a sentence; None if the value is valid."""
        if value is None and self.default is None:
            return None
        if self.form == "texture":
            if isinstance(value, int):
                return None
            return Sentence("texture-number-invalid", "is {value}; it must be the number of a texture", value=repr(value))
        if self.form == "name":
            return (
                None
                if isinstance(value, str) and (value == "" or is_name(value))
                else Sentence(
                    "name-invalid",
                    "is {value}; it must be a name of 1 to {length} letters, digits, spaces, - and _",
                    value=repr(value)[:80],
                    length=MAX_NAME,
                )
            )
        if self.form == "flag":
            if isinstance(value, bool):
                return None
            return Sentence("flag-invalid", "is {value}; it must be true or false", value=repr(value))
        if self.form == "choice":
            return (
                None
                if value in self.choices
                else Sentence("value-unknown", "is {value}; known are {choices}", value=repr(value), choices=[*self.choices])
            )
        count = {"color": 3, "radiance": 3, "triple": 3, "pair": 2}.get(self.form)
        numbers = [value] if count is None else list(value)
        if count is not None and len(numbers) != count:
            return Sentence("numbers-count-wrong", "has {found} numbers; it needs {count}", found=len(numbers), count=count)
        for number in numbers:
            if not self.low <= number <= self.high or (self.above and number == self.low):
                if self.above:
                    return Sentence(
                        "number-too-small", "is {number}; it must be above {low}", number=f"{number:g}", low=f"{self.low:g}"
                    )
                return Sentence(
                    "number-out-of-range",
                    "is {number}; it must be from {low} to {high}",
                    number=f"{number:g}",
                    low=f"{self.low:g}",
                    high=f"{self.high:g}",
                )
        return None


def _field(form: Form, default: Any, in_file: str | None, kinds: tuple[str, ...], **more: Any) -> Any:
    def of(name: str) -> Parameter:
        return Parameter(name, form, default, kinds, in_file or name, **more)

    return field(default=default, metadata={_KEY: of})


def number(
    default: float | None,
    column: int | None = None,
    low: float = 0.0,
    high: float = 1.0,
    kinds: tuple[str, ...] = PRINCIPLED,
    form: Literal["number", "degrees"] = "number",
    **more: Any,
) -> Any:
    """Declares a numeric parameter with the range `low` to `high`.

    form: with `degrees`, the number is stored in radians and written in degrees in scene files.
    """
    return _field(form, default, None, kinds, column=column, low=low, high=high, **more)


def flag_parameter(column: int | None = None, kinds: tuple[str, ...] = PRINCIPLED, **more: Any) -> Any:
    """Declares a boolean parameter, False by default."""
    return _field("flag", False, None, kinds, column=column, **more)


def name_parameter(kinds: tuple[str, ...] = PRINCIPLED, **more: Any) -> Any:
    """Declares a parameter that is a name, empty by default."""
    return _field("name", "", None, kinds, **more)


def choice_parameter(default: str, choices: tuple[str, ...], kinds: tuple[str, ...] = SURFACES, **more: Any) -> Any:
    """Declares a parameter whose value is one of a list of names."""
    return _field("choice", default, None, kinds, choices=choices, **more)


def color(
    default: float,
    column: int | None = None,
    high: float = 1.0,
    kinds: tuple[str, ...] = PRINCIPLED,
    in_file: str | None = None,
    form: Literal["color", "radiance", "triple"] = "color",
    **more: Any,
) -> Any:
    """Declares a parameter of three numbers, grey by default: a colour, a radiance, or another quantity per colour channel."""
    return _field(form, (default,) * 3, in_file, kinds, column=column, low=0.0, high=high, **more)


def values(low: float, high: float, column: int, maximum: float, **more: Any) -> Any:
    """Declares a parameter of two numbers between which a texture interpolates.

    low, high: the default values of the two. maximum: the greatest valid value of either; the least is 0.
    """
    return _field("pair", (low, high), None, PRINCIPLED, column=column, low=0.0, high=maximum, **more)


def texture(slot: int | None, kinds: tuple[str, ...] = PRINCIPLED, in_file: str | None = None, **more: Any) -> Any:
    """Declares an optional texture parameter of a material.

    slot: its column in the material row; None for one that is resolved when a scene is compiled. kinds: material kinds that have
    it. in_file: its name in scene files, if that differs from the field's.
    """
    return _field("texture", None, in_file, kinds, slot=slot, **more)


def parameters_of(table: type) -> tuple[Parameter, ...]:
    """Returns the parameters declared by the fields of a dataclass, in order."""
    found = []
    for each in fields(table):
        of: Callable[[str], Parameter] | None = each.metadata.get(_KEY)
        if of is not None:
            found.append(of(each.name))
    return tuple(found)
