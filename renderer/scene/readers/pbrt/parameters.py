"""Parameters of statements by name and type, such as `"float radius" 2`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Vec3
from renderer.scene.readers.pbrt.notes import Notes, Place
from renderer.scene.readers.pbrt.statements import Argument, Statement
from renderer.sentences import Sentence

__all__ = ["Parameter", "Parameters"]

F64 = npt.NDArray[np.float64]
_WIDTHS = {"point2": 2, "vector2": 2, "point3": 3, "vector3": 3, "point": 3, "vector": 3, "normal3": 3, "normal": 3, "rgb": 3}
_NUMBERS = ("float", "integer", "blackbody", *_WIDTHS)
_TYPES = (*_NUMBERS, "string", "texture", "bool", "spectrum")
_COLORS = ("rgb", "blackbody", "spectrum")


class Parameter(NamedTuple):
    """A parameter's value, with its type and its position in the file."""

    type: str
    value: Argument
    place: Place
    space: str  # colour space of an rgb


@dataclass
class Parameters:
    """The parameters of a statement; records which of them are used.

    what: the kind of object, such as "material"; type: its type, such as "diffuse".
    defaults: parameters from Attribute directives, each with the set that records the used names of its directive.
    repeated: names given more than once. cut: for each parameter with surplus numbers, the counts of given and of used numbers.
    """

    what: str
    type: str
    place: Place
    values: dict[str, Parameter] = field(default_factory=dict)
    defaults: dict[str, tuple[Parameter, set[str]]] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    repeated: set[str] = field(default_factory=set)
    cut: dict[str, tuple[int, int]] = field(default_factory=dict)
    space: str = "srgb"  # current colour space

    @classmethod
    def parse(cls, what: str, statement: Statement, names: int, space: str) -> tuple[list[str], Parameters]:
        """Parses the arguments of a directive: returns its leading names, and its parameters.

        names: number of leading names, the last of which is the type of the object, such as "diffuse". Raises SceneError if a
        name is missing or a parameter malformed.
        """
        place, arguments = statement.place, statement.arguments
        first = arguments[:names]
        if len(first) < names or not all(isinstance(each, str | tuple) for each in first):
            raise place.error(
                Sentence(
                    "pbrt-directive-name-count",
                    '{directive} needs 1 name in quotes, such as "diffuse"',
                    directive=statement.directive,
                )
                if names == 1
                else Sentence(
                    "pbrt-directive-names-expected",
                    '{directive} needs {count} names in quotes, such as "diffuse"',
                    directive=statement.directive,
                    count=names,
                )
            )
        called = [each if isinstance(each, str) else str(each[0]) if len(each) else "" for each in first]
        made = cls(what, called[-1] if called else "", place, space=space)
        rest = arguments[names:]
        for declared, value in zip(rest[::2], rest[1::2], strict=False):
            parameter, name = _declared(declared, value, statement, space)
            if name in made.values:
                made.repeated.add(name)
            made.values[name] = parameter
        if len(rest) % 2:
            raise place.error(
                Sentence(
                    "pbrt-parameter-without-value",
                    '{what} has a parameter without a value; write it as "float radius" 2',
                    what=made,
                )
            )
        return called, made

    def __str__(self) -> str:
        return f"{self.what} {self.type[:60]!r}" if self.type else self.what

    def get(self, name: str, *types: str) -> Parameter | None:
        """Returns a parameter and records it as used; None if absent. Raises SceneError if its type is not among `types`."""
        self.used.add(name)
        found = self.values.get(name)
        if found is None and name in self.defaults:
            found, asked = self.defaults[name]
            asked.add(name)
        if found is None:
            return None
        if types and found.type not in types:
            raise found.place.error(
                Sentence(
                    "pbrt-parameter-type-wrong",
                    "{name} of {what} has the type {type}; possible are {types}",
                    name=repr(name),
                    what=self,
                    type=found.type,
                    types=[*dict.fromkeys(types)],
                )
            )
        return found

    def number(self, name: str, default: float) -> float:
        """Returns the first number of a float or integer parameter, or the default if it is absent."""
        found = self.get(name, "float", "integer")
        return default if found is None else float(self._check_count(found, name, 1)[0])

    def integer(self, name: str, default: int) -> int:
        """Returns a parameter's first number, truncated to an integer and clamped to 32 bits; the default if it is absent."""
        return int(min(max(self.number(name, default), -(2**31)), 2**31 - 1))

    def boolean(self, name: str, default: bool) -> bool:
        """Returns a boolean parameter, which older files write as a string."""
        found = self.get(name, "bool", "string")
        if found is None or isinstance(found.value, np.ndarray) or not len(found.value):
            return default
        value = found.value if isinstance(found.value, str) else found.value[0]
        return value if isinstance(value, bool) else value == "true"

    def text(self, name: str, default: str = "") -> str:
        """Returns a string parameter, or the name of a texture or spectrum."""
        found = self.get(name, "string", "texture", "spectrum")
        return default if found is None else text_of(found) or default

    def texts(self, name: str) -> tuple[str, ...]:
        """Returns a string parameter with several values; empty if absent."""
        found = self.get(name, "string")
        if found is None or isinstance(found.value, np.ndarray):
            return ()
        return (found.value,) if isinstance(found.value, str) else tuple(str(each) for each in found.value)

    def vector(self, name: str, default: Vec3) -> Vec3:
        """Returns a point, vector or normal parameter."""
        found = self.get(name, "point3", "vector3", "point", "vector", "normal", "normal3")
        if found is None:
            return default
        x, y, z = (float(v) for v in self._check_count(found, name, 3)[:3])
        return x, y, z

    def numbers(self, name: str, *types: str) -> F64 | None:
        """Returns (n,) numbers, or (n, width) for points, vectors and normals; None if absent."""
        found = self.get(name, *(types or _NUMBERS))
        if found is None:
            return None
        values = self._check_count(found, name, 0)
        width = _WIDTHS.get(found.type, 1)
        if len(values) % width:
            raise found.place.error(
                Sentence(
                    "pbrt-parameter-number-count",
                    "{name} of {what} has {count} numbers; their number must be a multiple of {multiple}",
                    name=repr(name),
                    what=self,
                    count=len(values),
                    multiple=width,
                )
            )
        return values.reshape(-1, width) if width > 1 else values

    def names_texture(self, name: str) -> bool:
        """Returns True if a parameter refers to a texture."""
        found = self.values.get(name) or self.defaults.get(name, (None,))[0]
        return found is not None and found.type == "texture"

    def color(self, name: str) -> Parameter | None:
        """Returns a colour parameter: an RGB value, a black body or a spectrum; None if absent."""
        return self.get(name, *_COLORS)

    def say_unused(self, notes: Notes) -> None:
        """Adds notes about parameters that are unused, repeated, or have surplus numbers."""
        for name, parameter in self.values.items():
            if name not in self.used:
                notes.add(
                    parameter.place,
                    Sentence("pbrt-parameter-ignored", "{name} of {what} is ignored", name=repr(name[:60]), what=self),
                )
            elif name in self.repeated:
                notes.add(
                    parameter.place,
                    Sentence(
                        "parameter-given-twice",
                        "{name} of {what} is given more than once: the last one is used",
                        name=repr(name[:60]),
                        what=self,
                    ),
                )
            elif name in self.cut:
                count, least = self.cut[name]
                notes.add(
                    parameter.place,
                    Sentence(
                        "pbrt-parameter-numbers-dropped",
                        "{name} of {what} has {count} numbers: the first {used} are used",
                        name=repr(name[:60]),
                        what=self,
                        count=count,
                        used=least,
                    ),
                )

    def _check_count(self, found: Parameter, name: str, min_count: int) -> F64:
        if not isinstance(found.value, np.ndarray) or len(found.value) < min_count:
            raise found.place.error(
                Sentence("pbrt-parameter-not-number", "{name} of {what} must be a number", name=repr(name), what=self)
                if min_count == 1
                else Sentence("pbrt-parameter-not-number-list", "{name} of {what} must be numbers", name=repr(name), what=self)
            )
        if 0 < min_count < len(found.value):
            self.cut[name] = len(found.value), min_count
        return found.value


def text_of(found: Parameter) -> str:
    """Returns the string value of a parameter, the first of several; empty for numbers."""
    value = found.value
    if isinstance(value, str):
        return value
    return str(value[0]) if isinstance(value, tuple) and value else ""


def _declared(declared: Argument, value: Argument, statement: Statement, space: str) -> tuple[Parameter, str]:
    words = declared.split() if isinstance(declared, str) else []
    if len(words) != 2 or words[0] not in _TYPES:
        said = declared[:40] if isinstance(declared, str) else "a value"
        raise statement.place.error(
            Sentence(
                "pbrt-parameter-malformed",
                '{text} of {directive} is not a parameter; write a type and a name, such as "float radius"',
                text=repr(said),
                directive=statement.directive,
            )
        )
    kind, name = words
    if kind in _NUMBERS and not isinstance(value, np.ndarray):
        raise statement.place.error(
            Sentence(
                "pbrt-parameter-not-numbers",
                "{name} of {directive} needs numbers",
                name=repr(name[:60]),
                directive=statement.directive,
            )
        )
    return Parameter(kind, value, statement.place, space), name
