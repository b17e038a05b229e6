"""Variation of a scene by seed: distributions of poses, materials, lights and the environment, and the values drawn from them.

A value is a function of the seed, the number of the variation and the value's name alone: SHA-256 in counter mode gives the
random numbers, and all arithmetic is that of IEEE 754 or of `decimal`, which rounds correctly. So every machine draws the same
bits. renderer/scene/vary.py applies a variation to a scene.
"""

from __future__ import annotations

import decimal
import fnmatch
import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from renderer.errors import SettingsError
from renderer.sentences import Sentence, first_items

__all__ = ["DISTRIBUTIONS", "ENVIRONMENT", "LIGHTS", "OBJECTS", "SECTIONS", "Distribution", "Draws", "Form", "Value", "Variation"]

Value = float | str | bool | tuple[float, ...]
Form = Literal["number", "triple", "name", "flag", "any"]

_MOST_NAMES = 12  # names that a sentence lists
_MOST_RULES = 1000
_MOST_CHARACTERS = 200  # of a name or pattern; translating a long pattern takes a time that grows with its square
_MOST_CHOICES = 10_000
_REDRAWS = 64
_LARGEST = 1e15
MAX_SEED = 2**53

# What a rule of each section may vary, with the form of its values. Materials have the parameters of scene files.
OBJECTS: dict[str, Form] = {
    "move": "triple",  # added to the position, scene units
    "turn": "number",  # degrees about the scene's up axis through the object's centre
    "tumble": "flag",  # any rotation about the centre, uniformly
    "scale": "number",  # factor about the centre
    "material": "name",  # of the scene's
}
LIGHTS: dict[str, Form] = {"power": "number", "color": "triple", "move": "triple"}
ENVIRONMENT: dict[str, Form] = {"light": "name", "strength": "number", "rotation": "number", "color": "triple"}
SECTIONS = ("objects", "materials", "lights", "environment")
_FORMS: dict[str, Mapping[str, Form]] = {"objects": OBJECTS, "lights": LIGHTS, "environment": ENVIRONMENT}

DISTRIBUTIONS = ("uniform", "log_uniform", "normal", "choice", "shell")


class Draws:
    """A sequence of random numbers that follows from a name: the same on every machine."""

    def __init__(self, name: str) -> None:
        self._name, self._count = name, 0

    def number(self) -> float:
        """Returns the next number, uniform in [0, 1), a multiple of 2^-53."""
        hashed = hashlib.sha256(f"{self._name}#{self._count}".encode()).digest()
        self._count += 1
        return (int.from_bytes(hashed[:8], "big") >> 11) * 2.0**-53

    def normal(self) -> float:
        """Returns the next number of the standard normal distribution, by Marsaglia's polar method."""
        while True:
            x, y = 2.0 * self.number() - 1.0, 2.0 * self.number() - 1.0
            s = x * x + y * y
            if 0.0 < s < 1.0:
                return x * math.sqrt(-2.0 * _ln(s) / s)

    def direction(self) -> tuple[float, float, float]:
        """Returns a direction, uniform on the unit sphere, by Marsaglia's method of 1972."""
        while True:
            x, y = 2.0 * self.number() - 1.0, 2.0 * self.number() - 1.0
            s = x * x + y * y
            if s < 1.0:
                root = 2.0 * math.sqrt(1.0 - s)
                return x * root, y * root, 1.0 - 2.0 * s

    def quaternion(self) -> tuple[float, float, float, float]:
        """Returns a unit quaternion (w, x, y, z), uniform over all rotations, by Marsaglia's method of 1972."""
        pairs: list[tuple[float, float, float]] = []
        while len(pairs) < 2:
            x, y = 2.0 * self.number() - 1.0, 2.0 * self.number() - 1.0
            s = x * x + y * y
            if 0.0 < s < 1.0:
                pairs.append((x, y, s))
        (w, x, first), (y, z, second) = pairs
        root = math.sqrt((1.0 - first) / second)
        return w, x, y * root, z * root


@dataclass(frozen=True)
class Distribution:
    """A distribution of numbers, of triples of numbers, or of other values.

    kind: of DISTRIBUTIONS; a constant is a choice of one value. low, high: the ends of uniform, log_uniform and shell, or the
    mean and the deviation of normal; tuples for triples. within: the ends to which a normal distribution is truncated.
    """

    kind: str
    low: Any = 0.0
    high: Any = 0.0
    values: tuple[Value, ...] = ()
    weights: tuple[float, ...] = ()
    within: tuple[float, float] | None = None

    @classmethod
    def parse(cls, given: Any, place: str, form: Form = "any") -> Distribution:
        """Returns the distribution of a scene file's or request's value. Raises SettingsError.

        given: a constant, or {uniform: [a, b]}, {log_uniform: [a, b]}, {normal: [mean, deviation], within: [a, b]},
        {choice: [...], weights: [...]}, {shell: [a, b]}. place: the value's name for errors. form: of its values.
        """
        if not isinstance(given, Mapping):
            return cls("choice", values=(_value(given, place, form),))
        kinds = [name for name in given if name in DISTRIBUTIONS]
        extra = {*given} - {*kinds} - ({"within"} if kinds == ["normal"] else {"weights"} if kinds == ["choice"] else set())
        if len(kinds) != 1 or extra:
            raise _no_distribution(place, given)
        kind, value = kinds[0], given[kinds[0]]
        if kind == "choice":
            return cls._choice(value, given.get("weights"), place, form)
        if form in ("name", "flag") or not isinstance(value, list | tuple) or len(value) != 2:
            raise _no_distribution(place, given)
        if kind == "shell" and form not in ("triple", "any"):
            raise _no_distribution(place, given)
        low, high = (_value(each, place, "number" if kind == "shell" else form) for each in value)
        if len(_listed(low)) != len(_listed(high)) or not all(
            _is_valid(kind, a, b) for a, b in zip(_listed(low), _listed(high), strict=True)
        ):
            raise _no_distribution(place, given)
        limits = given.get("within")
        return cls(kind, low, high, within=None if limits is None else _limits(limits, place))

    @classmethod
    def _choice(cls, values: Any, weights: Any, place: str, form: Form) -> Distribution:
        if not isinstance(values, list | tuple) or not 0 < len(values) <= _MOST_CHOICES:
            raise _no_distribution(place, {"choice": values})
        found = tuple(_value(each, place, form) for each in values)
        if weights is None:
            return cls("choice", values=found)
        shares = [_number(each, place) for each in weights] if isinstance(weights, list | tuple) else []
        if len(shares) != len(found) or min(shares) < 0 or max(shares) == 0:
            raise _no_distribution(place, {"choice": values, "weights": weights})
        return cls("choice", values=found, weights=tuple(shares))

    def draw(self, draws: Draws) -> Value:
        """Returns a value of the distribution."""
        if self.kind == "choice":
            return self._chosen(draws)
        if self.kind == "shell":
            radius = self.low + (self.high - self.low) * draws.number()
            return tuple(radius * each for each in draws.direction())
        ends = list(zip(_listed(self.low), _listed(self.high), strict=True))
        found = tuple(self._number(draws, a, b) for a, b in ends)
        return found if isinstance(self.low, tuple) else found[0]

    def _number(self, draws: Draws, a: float, b: float) -> float:
        if self.kind == "uniform":
            return a + (b - a) * draws.number()
        if self.kind == "log_uniform":
            return min(max(a * _exp(draws.number() * _ln(b / a)), a), b)
        found = a + b * draws.normal()
        if self.within is None:
            return found
        low, high = self.within
        for _ in range(_REDRAWS):
            if low <= found <= high:
                return found
            found = a + b * draws.normal()
        return min(max(found, low), high)

    def _chosen(self, draws: Draws) -> Value:
        if len(self.values) == 1:
            return self.values[0]
        if not self.weights:
            return self.values[int(draws.number() * len(self.values))]
        left = draws.number() * math.fsum(self.weights)
        for value, weight in zip(self.values, self.weights, strict=True):
            left -= weight
            if left < 0:
                return value
        return next(value for value, weight in zip(self.values[::-1], self.weights[::-1], strict=True) if weight > 0)


Rules = dict[str, dict[str, Distribution]]


@dataclass(frozen=True)
class Variation:
    """How a scene varies from view to view.

    objects, materials, lights: distributions by the pattern of names they apply to (as in a shell: *, ?, [...]), then by what
    they vary. environment: distributions by what they vary. every: number of consecutive views that have the same values.
    """

    seed: int = 0
    every: int = 1
    objects: Rules = field(default_factory=dict)
    materials: Rules = field(default_factory=dict)
    lights: Rules = field(default_factory=dict)
    environment: dict[str, Distribution] = field(default_factory=dict)

    @classmethod
    def parse(cls, given: Any) -> Variation:
        """Returns the variation that a mapping describes. Raises SettingsError."""
        whole = _mapping(given, "vary", (*SECTIONS, "seed", "every"))
        seed, every = whole.get("seed", 0), whole.get("every", 1)
        for name, value, low in (("seed", seed, 0), ("every", every, 1)):
            if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= MAX_SEED:
                raise SettingsError(
                    Sentence(
                        "vary-not-whole-number",
                        "vary.{name} is {value}; it must be a whole number of at least {low}",
                        name=name,
                        value=_shown(value)[:80],
                        low=low,
                    ),
                    field="vary",
                )
        rules: dict[str, Rules] = {}
        for section in ("objects", "materials", "lights"):
            rules[section] = {}
            for pattern, values in _mapping(whole.get(section, {}), f"vary.{section}").items():
                place = f"vary.{section}.{pattern}"
                forms = _FORMS.get(section)
                named = _mapping(values, place, forms)
                rules[section][pattern] = {
                    name: Distribution.parse(value, f"{place}.{name}", "any" if forms is None else forms[name])
                    for name, value in named.items()
                }
        named = _mapping(whole.get("environment", {}), "vary.environment", ENVIRONMENT)
        environment = {
            name: Distribution.parse(value, f"vary.environment.{name}", ENVIRONMENT[name]) for name, value in named.items()
        }
        if not environment and not any(any(each.values()) for each in rules.values()):
            raise SettingsError(
                Sentence("vary-empty", "vary varies nothing; name {sections}", sections=[*SECTIONS]), field="vary"
            )
        return cls(seed, every, rules["objects"], rules["materials"], rules["lights"], environment)

    def number_of(self, view: float) -> int:
        """Returns the number of a view's variation: its values follow from this number. view: a frame number."""
        return int(view // self.every)

    def draws(self, number: int, *name: str) -> Draws:
        """Returns the random numbers of one value. number: of the variation. name: section, object and value."""
        return Draws("/".join([str(self.seed), str(number), *(each.replace("/", "//") for each in name)]))

    def drawn(self, section: str, names: Iterable[str], number: int) -> dict[str, dict[str, Value]]:
        """Returns the values of a section's things in a variation, by name; the first pattern that matches a name applies.

        names: of the scene's objects, materials or lights. Raises SettingsError if a pattern matches none of them.
        """
        rules: Rules = getattr(self, section)
        known = list(dict.fromkeys(names))
        self._check_patterns(section, rules, known)
        found: dict[str, dict[str, Value]] = {}
        for name in known:
            values = next((values for pattern, values in rules.items() if fnmatch.fnmatchcase(name, pattern)), None)
            if values:
                found[name] = {
                    each: self._value(section, each, distribution, self.draws(number, section, name, each))
                    for each, distribution in values.items()
                }
        return found

    def drawn_environment(self, number: int) -> dict[str, Value]:
        """Returns the values of the environment in a variation."""
        return {name: each.draw(self.draws(number, "environment", name)) for name, each in self.environment.items()}

    def check_names(self, section: str, names: Iterable[str]) -> None:
        """Raises SettingsError if a pattern of a section matches none of the scene's names."""
        self._check_patterns(section, getattr(self, section), list(names))

    @staticmethod
    def _value(section: str, name: str, distribution: Distribution, draws: Draws) -> Value:
        value = distribution.draw(draws)
        return draws.quaternion() if (section, name) == ("objects", "tumble") and value else value

    @staticmethod
    def _check_patterns(section: str, rules: Rules, names: list[str]) -> None:
        for pattern in rules:
            if not any(fnmatch.fnmatchcase(name, pattern) for name in names):
                raise SettingsError(
                    Sentence(
                        "vary-name-unknown",
                        "vary.{section}: {pattern} is none of the scene's; it has {names}",
                        section=section,
                        pattern=repr(pattern[:60]),
                        names=first_items((each[:60] for each in names or ["-"]), _MOST_NAMES),
                    ),
                    field="vary",
                )


def _mapping(given: Any, place: str, known: Iterable[str] | None = None) -> dict[str, Any]:
    """Returns a mapping from names of `known`, or any names. Raises SettingsError."""
    names = None if known is None else list(known)
    if not isinstance(given, Mapping) or len(given) > _MOST_RULES:
        raise SettingsError(
            Sentence(
                "vary-no-mapping",
                "{place} must be a mapping of at most {most} names",
                place=place[:200],
                most=_MOST_RULES,
            ),
            field="vary",
        )
    for name in given:
        if not isinstance(name, str) or len(name) > _MOST_CHARACTERS or (names is not None and name not in names):
            raise SettingsError(
                Sentence(
                    "vary-field-unknown",
                    "{place} has {name}, which is not known; known are {names}",
                    place=place[:200],
                    name=_shown(name)[:60],
                    names=names or ["-"],
                ),
                field="vary",
            )
    return dict(given)


def _value(given: Any, place: str, form: Form) -> Value:
    """Returns a single value, with lists as tuples of floats. Raises SettingsError if it has another form."""
    if isinstance(given, bool):
        found: Value | None = given if form in ("flag", "any") else None
    elif isinstance(given, int | float):
        is_valid = form in ("number", "any") and abs(given) <= _LARGEST
        found = float(given) if is_valid else None
    elif isinstance(given, str):
        found = given if form in ("name", "any") and len(given) <= _MOST_CHARACTERS else None
    elif isinstance(given, list | tuple) and form in ("triple", "any"):
        numbers = [each for each in given if isinstance(each, int | float) and not isinstance(each, bool)]
        is_valid = len(numbers) == len(given) and (len(numbers) == 3 or (form == "any" and len(numbers) == 2))
        found = tuple(map(float, numbers)) if is_valid and all(abs(each) <= _LARGEST for each in numbers) else None
    else:
        found = None
    if found is None:
        raise _no_distribution(place, given)
    return found


def _number(given: Any, place: str) -> float:
    return float(_value(given, place, "number"))  # type: ignore[arg-type]


def _limits(given: Any, place: str) -> tuple[float, float]:
    """Returns the ends of a range. Raises SettingsError if it is empty."""
    found = [_number(each, place) for each in given] if isinstance(given, list | tuple) else []
    if len(found) != 2 or not found[0] < found[1]:
        raise _no_distribution(f"{place}.within", given)
    return found[0], found[1]


def _is_valid(kind: str, low: Any, high: Any) -> bool:
    """Returns True if two numbers are the ends of a distribution, or the mean and the deviation of a normal one."""
    if isinstance(low, str | bool) or isinstance(high, str | bool):
        return False
    if kind == "normal":
        return bool(high >= 0)
    return bool(low <= high and (low > 0 or kind != "log_uniform") and (low >= 0 or kind != "shell"))


def _no_distribution(place: str, given: Any) -> SettingsError:
    return SettingsError(
        Sentence(
            "vary-distribution-invalid",
            "{place} is {value}; give a value that fits, or one of uniform: [low, high], log_uniform: [low, high], "
            "normal: [mean, deviation], choice: [values], and for positions shell: [radius, radius]",
            place=place[:200],
            value=_shown(given)[:120],
        ),
        field="vary",
    )


def _shown(given: Any) -> str:
    """Returns a value as text for an error; "..." if it is nested too deeply, or has a number of too many digits, to be shown."""
    try:
        return repr(given)
    except (RecursionError, ValueError):
        return "..."


def _listed(value: Any) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


_CONTEXT = decimal.Context(prec=30, Emin=-9999, Emax=9999)


def _ln(x: float) -> float:
    """Returns the natural logarithm, correctly rounded but for ties in the 30th digit."""
    return float(_CONTEXT.ln(decimal.Decimal(x)))


def _exp(x: float) -> float:
    """Returns the exponential, as `_ln`."""
    return float(_CONTEXT.exp(decimal.Decimal(x)))
