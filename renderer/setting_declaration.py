"""Declares settings once: name, type and default as a dataclass field, everything else in the field's annotation.

    max_depth: Annotated[int, Setting(1, MAX_DEPTH), SettingTexts("Max depth", "Path segments.")] = 8

The checks of the settings, the command's options, the API's models and the scene file's schema are derived from the `table` of
the dataclass. With renderer/setting_docs.py, so are the response of GET /api/info, the page's form and the table of differences
between two images.
"""

from __future__ import annotations

import functools
import re
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import Annotated, Any, Literal, Self, get_args, get_origin, get_type_hints

from renderer.errors import SettingsError
from renderer.sentences import Sentence

__all__ = [
    "MAX_NAME",
    "NAME_PATTERN",
    "Choices",
    "DeclaredSetting",
    "Setting",
    "SettingTexts",
    "checked",
    "is_name",
    "number_text",
    "table",
    "whole",
]

MAX_NAME = 40  # characters of a name in a list of names
NAME_PATTERN = r"^[\w-]([\w -]*[\w-])?$"  # of a name


@dataclass(frozen=True)
class SettingTexts:
    """The user-facing texts of a setting or of one of its choices.

    They affect no sample, so renderer/sources.py does not hash them. group: where the setting is shown: among the basic ones, the
    advanced ones, or those for comparing renderers. section: its heading in the command's help and on the page. integrators,
    projections: those that use the setting; empty for all. off: label of the value `Setting.off`, a `Sentence`. option: the
    command's option, if its name differs from the setting's. phrase: describes an image by the setting's value, which replaces
    {}. usual: the usual range, for a slider; None if a slider does not help.
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
    """The names that a setting accepts, in the order of their numbers in kernels, with the user-facing texts of each."""

    shown: Mapping[str, SettingTexts]

    def __new__(cls, shown: Mapping[str, SettingTexts]) -> Self:
        """Creates the choices from a mapping of name to texts."""
        made = super().__new__(cls, shown)
        made.shown = dict(shown)
        return made


@dataclass(frozen=True)
class Setting:
    """The values that a setting accepts: numbers from low to high (for each component of a vector), or names.

    off: the value that switches the setting off, which may be below `low`. names: the most names that a list of names may have,
    separated by commas.
    of: "job": requests and scene files may set it; "environment": a request's environment sets it; "": internal.
    digest: whether an image's bits depend on the setting.
    """

    low: float | None = None
    high: float | None = None
    choices: Choices | None = None
    off: float | None = None
    names: int | None = None
    of: Literal["job", "environment", ""] = "job"
    digest: bool = True


@dataclass(frozen=True)
class DeclaredSetting:
    """A setting with the name, type and default of its dataclass field. `default` is MISSING if a value is required."""

    name: str
    kind: type
    optional: bool
    default: Any
    setting: Setting
    shown: SettingTexts

    def check(self, value: Any) -> Any:
        """Returns the value converted to the field's type. Raises SettingsError for a value that the setting does not accept."""
        if value is None and self.optional:
            return None
        if self.setting.names is not None:
            return self._names(value, self.setting.names)
        if self.setting.choices is not None:
            if isinstance(value, str) and value in self.setting.choices:
                return value
            raise self._error(
                Sentence(
                    "setting-value-unknown",
                    "{setting} is {value}; known are {choices}",
                    setting=self.name,
                    value=_shown(value),
                    choices=[name or Sentence("choice-none", "none at all") for name in self.setting.choices],
                )
            )
        if self.kind is tuple:
            if not isinstance(value, (tuple, list)) or len(value) != 3:
                raise self._wrong_type(value)
            return tuple(self._number(part, value) for part in value)
        return self._number(value, value)

    def _names(self, value: Any, most: int) -> str:
        """Returns a list of names, separated by commas, without spaces around them."""
        names = [name.strip() for name in value.split(",")] if isinstance(value, str) and value.strip() else []
        if not isinstance(value, str) or not all(map(is_name, names)):
            raise self._error(
                Sentence(
                    "setting-names-invalid",
                    "{setting} is {value}; it takes names of 1 to {length} letters, digits, spaces, - and _, separated by commas",
                    setting=self.name,
                    value=_shown(value),
                    length=MAX_NAME,
                )
            )
        if len(names) > most or len({*names}) < len(names):
            raise self._error(
                Sentence(
                    "setting-names-too-many",
                    "{setting} has {count} names; it takes at most {most}, each once",
                    setting=self.name,
                    count=len(names),
                    most=most,
                )
            )
        return ",".join(names)

    def _number(self, value: Any, whole: Any) -> Any:
        if isinstance(value, bool) or not isinstance(value, (int, float, Integral, Real)):
            raise self._wrong_type(whole)
        number = value if isinstance(value, int) else int(value) if isinstance(value, Integral) else float(value)
        if self.kind is int and isinstance(number, float) and not number.is_integer():
            raise self._wrong_type(whole)
        low, high, off = self.setting.low, self.setting.high, self.setting.off
        assert low is not None
        assert high is not None
        if not (low <= number <= high or number == off):
            raise self._error(self._range_error(_shown(whole), number_text(low), number_text(high)))
        return int(number) if self.kind is int else float(number)

    def _range_error(self, value: str, low: str, high: str) -> str:
        off = self.setting.off
        if off is not None:
            return Sentence(
                "setting-out-of-range-or-off",
                "{setting} is {value}; it lies between {low} and {high}, or is {off}: {meaning}",
                setting=self.name,
                value=value,
                low=low,
                high=high,
                off=number_text(off),
                meaning=self.shown.off,
            )
        if self.kind is tuple:
            return Sentence(
                "setting-parts-out-of-range",
                "{setting} is {value}; each of them lies between {low} and {high}",
                setting=self.name,
                value=value,
                low=low,
                high=high,
            )
        if self.shown.unit == "°":
            return Sentence(
                "setting-degrees-out-of-range",
                "{setting} is {value}; it lies between {low} and {high} degrees",
                setting=self.name,
                value=value,
                low=low,
                high=high,
            )
        return Sentence(
            "setting-out-of-range",
            "{setting} is {value}; it lies between {low} and {high}",
            setting=self.name,
            value=value,
            low=low,
            high=high,
        )

    def _wrong_type(self, value: Any) -> SettingsError:
        if self.kind is tuple:
            return self._error(
                Sentence(
                    "setting-not-three-numbers",
                    "{setting} is {value}; it takes three numbers",
                    setting=self.name,
                    value=_shown(value),
                )
            )
        if self.kind is int:
            return self._error(
                Sentence(
                    "setting-not-whole-number",
                    "{setting} is {value}; it takes a whole number",
                    setting=self.name,
                    value=_shown(value),
                )
            )
        return self._error(
            Sentence("setting-not-number", "{setting} is {value}; it takes a number", setting=self.name, value=_shown(value))
        )

    def _error(self, sentence: str) -> SettingsError:
        return SettingsError(sentence, field=self.name)

    @property
    def number(self) -> type:
        """Returns the numeric type of the setting, or of a vector's components."""
        return int if self.kind is int else float

    @property
    def lowest(self) -> float | None:
        """Returns the smallest accepted number, including `off`; None if there is none."""
        low, off = self.setting.low, self.setting.off
        return low if low is None or off is None else min(low, off)

    def json_schema(self) -> dict[str, Any]:
        """Returns the accepted values as JSON Schema."""
        return {"description": self.shown.help, **self._values()}

    def _values(self) -> dict[str, Any]:
        if self.setting.names is not None:
            return {"type": "string", "maxLength": (MAX_NAME + 2) * self.setting.names}
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
        """Returns the name of the command's option without its dashes."""
        return self.shown.option or self.name.replace("_", "-")


def is_name(text: str) -> bool:
    """Returns True if a list of names may contain this name; it is safe in the channel names of an EXR."""
    return len(text) <= MAX_NAME and re.fullmatch(NAME_PATTERN[1:-1], text) is not None


@functools.cache
def table(owner: type[Any]) -> Mapping[str, DeclaredSetting]:
    """Returns the settings that a dataclass declares, in the order of its fields."""
    hints = get_type_hints(owner, include_extras=True)
    found = {}
    for field in fields(owner):
        if get_origin(hints[field.name]) is not Annotated:
            continue
        either, setting, shown = get_args(hints[field.name])
        kinds = get_args(either) if isinstance(either, types.UnionType) else (either,)
        kind = next(each for each in kinds if each is not types.NoneType)
        optional = types.NoneType in kinds
        found[field.name] = DeclaredSetting(field.name, get_origin(kind) or kind, optional, field.default, setting, shown)
    return types.MappingProxyType(found)


def checked(owner: Any) -> None:
    """Checks all settings of a frozen dataclass, and converts each to its field's type; called from its __post_init__."""
    for declared in table(owner.__class__).values():
        object.__setattr__(owner, declared.name, declared.check(getattr(owner, declared.name)))


def whole(value: float | None) -> float | None:
    """Returns a number as JSON should show it: integral floats below 1e15 as int, other values unchanged."""
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else value


def _shown(value: Any) -> str:
    """Returns a rejected value as text for an error message; the middle of texts above 80 characters is omitted."""
    text = number_text(value) if isinstance(value, Real) and not isinstance(value, bool) else repr(value)
    return text if len(text) <= 80 else f"{text[:40]} ... {text[-20:]}"


def number_text(value: Any) -> str:
    """Returns a number as short text: floats with 6 significant digits, integers from 1e18 on as ">1e18"."""
    if isinstance(value, Integral):
        number = int(value)
        return str(number) if abs(number) < 10**18 else f"{'>' if number > 0 else '<-'}1e18"  # Python formats at most 4300 digits
    return f"{float(value):g}"
