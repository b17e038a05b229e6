"""A setting is declared once: its name, type and default as a dataclass' field, all else in that field's annotation.

    max_depth: Annotated[int, Setting(1, MAX_DEPTH), Shown("Max depth", "Path segments.")] = 8

From `table` of the dataclass follow its checks, the command's options, the API's models, the scene file's schema; and, by
renderer/setting_docs.py, what GET /api/info says, the page's form and the list in which two pictures differ.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import Annotated, Any, Literal, Self, get_args, get_origin, get_type_hints

from renderer.errors import SettingsError

__all__ = ["Choices", "Declared", "Setting", "Shown", "checked", "number_text", "table", "whole"]


@dataclass(frozen=True)
class Shown:
    """What is said to people of a setting, or of one of its choices. renderer/sources.py leaves it out: it decides no sample.

    group: where it is asked for: among the first, among what few change, or among what is there to compare renderers.
    section: what it stands beside, in the command's help and on the page.
    integrators, projections: those that look at it; none named: all.
    off: what `Setting.off` is called.
    option: the command's, where it is not called as the setting.
    phrase: names a picture by the value, in place of {}.
    usual: the range that people use, over which a slider goes; none where a slider helps nobody.
    """

    label: str
    help: str = ""
    unit: Literal["", "px", "°", "s", "fraction", "scene units", "radiance"] = ""
    group: Literal["basic", "advanced", "lab"] = "advanced"
    section: Literal["Size and quality", "View", "Environment", "Light", "Samples", "Schedule", "Time"] = "Light"
    integrators: tuple[str, ...] = ()
    projections: tuple[str, ...] = ()
    off: str = ""
    option: str = ""
    phrase: str = ""
    usual: tuple[float, float] | None = None


class Choices(tuple[str, ...]):
    """The names that a setting takes, in the order in which kernels number them, and what each is to people."""

    shown: Mapping[str, Shown]

    def __new__(cls, shown: Mapping[str, Shown]) -> Self:
        """From each name's label and sentence."""
        made = super().__new__(cls, shown)
        made.shown = dict(shown)
        return made


@dataclass(frozen=True)
class Setting:
    """The values that a setting takes: numbers from low to high, each of a vector's three, or names.

    off: the value that switches it off, taken also where it lies below `low`.
    of: "job": a request or a scene file may ask for it; "environment": a request's environment; "": no one is asked.
    digest: whether the picture's bits depend on it.
    """

    low: float | None = None
    high: float | None = None
    choices: Choices | None = None
    off: float | None = None
    of: Literal["job", "environment", ""] = "job"
    digest: bool = True


@dataclass(frozen=True)
class Declared:
    """A setting with the name, type and default of its field. `default` is MISSING where one has to be given."""

    name: str
    kind: type
    optional: bool
    default: Any
    setting: Setting
    shown: Shown

    def check(self, value: Any) -> Any:
        """The value in the field's own type. Raises SettingsError, with a sentence, where it is none of those it takes."""
        if value is None and self.optional:
            return None
        if self.setting.choices is not None:
            if isinstance(value, str) and value in self.setting.choices:
                return value
            raise self._wrong(value, f"known are {', '.join(name or 'none at all' for name in self.setting.choices)}")
        if self.kind is tuple:
            if not isinstance(value, (tuple, list)) or len(value) != 3:
                raise self._wrong(value, "it takes three numbers")
            return tuple(self._number(part, value) for part in value)
        return self._number(value, value)

    def _number(self, value: Any, whole: Any) -> Any:
        what = "three numbers" if self.kind is tuple else "a whole number" if self.kind is int else "a number"
        if isinstance(value, bool) or not isinstance(value, (int, float, Integral, Real)):
            raise self._wrong(whole, f"it takes {what}")
        number = value if isinstance(value, int) else int(value) if isinstance(value, Integral) else float(value)
        if self.kind is int and isinstance(number, float) and not number.is_integer():
            raise self._wrong(whole, f"it takes {what}")
        low, high, off = self.setting.low, self.setting.high, self.setting.off
        assert low is not None
        assert high is not None
        if not (low <= number <= high or number == off):
            between = f"lies between {number_text(low)} and {number_text(high)}{'' if self.shown.unit != '°' else ' degrees'}"
            also = f", or is {number_text(off)}: {self.shown.off}" if off is not None else ""
            raise self._wrong(whole, f"{'each of them' if self.kind is tuple else 'it'} {between}{also}")
        return int(number) if self.kind is int else float(number)

    def _wrong(self, value: Any, sentence: str) -> SettingsError:
        text = number_text(value) if isinstance(value, Real) and not isinstance(value, bool) else repr(value)
        if len(text) > 80:
            text = f"{text[:40]} ... {text[-20:]}"
        return SettingsError(f"{self.name} is {text}; {sentence}")

    @property
    def number(self) -> type:
        """What its number is, or each of its three."""
        return int if self.kind is int else float

    @property
    def lowest(self) -> float | None:
        """The least number that it takes, that which switches it off among them."""
        low, off = self.setting.low, self.setting.off
        return low if low is None or off is None else min(low, off)

    def json_schema(self) -> dict[str, Any]:
        """The values that it takes, as JSON Schema."""
        return {"description": self.shown.help, **self._values()}

    def _values(self) -> dict[str, Any]:
        if self.setting.choices is not None:
            return {"enum": list(self.setting.choices)}
        number = {
            "type": "integer" if self.kind is int else "number",
            "minimum": whole(self.lowest),
            "maximum": whole(self.setting.high),
        }
        return {"type": "array", "items": number, "minItems": 3, "maxItems": 3} if self.kind is tuple else number

    @property
    def option(self) -> str:
        """The command's option, without its dashes."""
        return self.shown.option or self.name.replace("_", "-")


@functools.cache
def table(owner: type[Any]) -> Mapping[str, Declared]:
    """The settings that a dataclass declares, in its fields' order."""
    hints = get_type_hints(owner, include_extras=True)
    found = {}
    for field in fields(owner):
        if get_origin(hints[field.name]) is not Annotated:
            continue
        either, setting, shown = get_args(hints[field.name])
        kinds = get_args(either) if isinstance(either, types.UnionType) else (either,)
        kind = next(each for each in kinds if each is not types.NoneType)
        optional = types.NoneType in kinds
        found[field.name] = Declared(field.name, get_origin(kind) or kind, optional, field.default, setting, shown)
    return types.MappingProxyType(found)


def checked(owner: Any) -> None:
    """For a frozen dataclass' __post_init__: each setting is one that it takes, and of its field's type."""
    for declared in table(owner.__class__).values():
        object.__setattr__(owner, declared.name, declared.check(getattr(owner, declared.name)))


def whole(value: float | None) -> float | None:
    """Whole numbers without a point, up to where JSON keeps them exactly."""
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else value


def number_text(value: Any) -> str:
    """As people write it."""
    if isinstance(value, Integral):
        return str(value) if abs(int(value)) < 10**18 else "too large"  # Python writes out no more than 4300 digits
    return f"{float(value):g}"
