"""What is said of a material's parameter, once: what it is, its range, where it is packed, and who calls it what.

renderer/scene/material.py has the table. Scenes are checked and packed by it, readers find their fields in it, and the scene
file's schema is filled in from it (renderer/scene/readers/yaml/schema.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from renderer.arrays.rows import KINDS

__all__ = [
    "EVERY_KIND",
    "PRINCIPLED",
    "SURFACES",
    "MaterialKind",
    "Parameter",
    "choice",
    "color",
    "flag",
    "number",
    "parameters_of",
    "texture",
    "values",
]

MaterialKind = str  # the name of one of `EVERY_KIND`

Form = Literal["number", "flag", "choice", "color", "radiance", "triple", "pair", "degrees", "texture"]

PRINCIPLED: tuple[str, ...] = ("metallic_roughness",)
EVERY_KIND: tuple[str, ...] = tuple(kind.name for kind in KINDS if kind.in_files)
SURFACES: tuple[str, ...] = tuple(kind for kind in EVERY_KIND if kind != "interface")  # the kinds that are seen

_KEY = "parameter"


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    column, slot: of `material` and `material_texture` (renderer/arrays/rows.py); None where packing makes more of it than a copy.
    kinds: those that know it. in_file: its name in scene files. gltf: the way to it from a glTF material, through objects and
    extensions, where its reader has nothing to add. mtl: the same of Wavefront's materials.
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
    above: bool = False  # whether `low` itself is too low
    choices: tuple[str, ...] = ()
    gltf: str | None = None
    mtl: str | None = None
    srgb: bool = False  # of textures: whether their colours are so encoded
    layered: bool = True  # of textures: whether the slot takes a stack of them

    def clamped(self, value: float) -> float:
        """The nearest number that it may be."""
        return min(max(value, self.low), self.high)

    def fault(self, value: Any) -> str | None:
        """What is wrong with a value, as the end of a sentence; None where nothing is."""
        if value is None and self.default is None:
            return None
        if self.form == "texture":
            return None if isinstance(value, int) else f"is {value!r}, and no texture's number"
        if self.form == "flag":
            return None if isinstance(value, bool) else f"is {value!r}; it is true or false"
        if self.form == "choice":
            return None if value in self.choices else f"is {value!r}; known are {', '.join(self.choices)}"
        count = {"color": 3, "radiance": 3, "triple": 3, "pair": 2}.get(self.form)
        numbers = [value] if count is None else list(value)
        if count is not None and len(numbers) != count:
            return f"has {len(numbers)} numbers; it takes {count}"
        for number in numbers:
            if not self.low <= number <= self.high or (self.above and number == self.low):
                bound = f"above {self.low:g}" if self.above else f"from {self.low:g} to {self.high:g}"
                return f"is {number:g}; it takes numbers {bound}"
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
    """A number from low to high; in `degrees` it is radians here and degrees in scene files."""
    return _field(form, default, None, kinds, column=column, low=low, high=high, **more)


def flag(column: int | None = None, kinds: tuple[str, ...] = PRINCIPLED, **more: Any) -> Any:
    """Yes or no, and no unless told."""
    return _field("flag", False, None, kinds, column=column, **more)


def choice(default: str, choices: tuple[str, ...], kinds: tuple[str, ...] = SURFACES, **more: Any) -> Any:
    """One of some names."""
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
    """Three numbers, grey unless told: a colour, a radiance, or something else at the three primaries."""
    return _field(form, (default,) * 3, in_file, kinds, column=column, low=0.0, high=high, **more)


def values(low: float, high: float, column: int, most: float, **more: Any) -> Any:
    """The two ends of something that a texture mixes; each from 0 to `most`."""
    return _field("pair", (low, high), None, PRINCIPLED, column=column, low=0.0, high=most, **more)


def texture(slot: int | None, kinds: tuple[str, ...] = PRINCIPLED, in_file: str | None = None, **more: Any) -> Any:
    """A texture, or none."""
    return _field("texture", None, in_file, kinds, slot=slot, **more)


def parameters_of(table: type) -> tuple[Parameter, ...]:
    """The parameters that a dataclass declares, in their order."""
    found = []
    for each in fields(table):
        of: Callable[[str], Parameter] | None = each.metadata.get(_KEY)
        if of is not None:
            found.append(of(each.name))
    return tuple(found)
