"""What a picture is asked to be: the view, the size, and everything else a sample's colour depends on.

A sample's colour is a function of (compiled scene, settings, pixel, sample number) alone; `RenderSettings` is the second of
these. Plain numpy-free data, so that the service and the client can build and check it without the kernel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any, NamedTuple

from renderer.errors import SettingsError

__all__ = [
    "FILTERS",
    "HEURISTICS",
    "INTEGRATORS",
    "LIGHT_CHOICES",
    "MAX_DEPTH",
    "MAX_FLOOR",
    "MAX_LIGHT_SAMPLES",
    "MAX_SIZE",
    "MAX_SPP",
    "MISTAKES",
    "OPTIONAL",
    "PROJECTIONS",
    "SAMPLERS",
    "SAMPLINGS",
    "RenderSettings",
    "Tile",
    "View",
    "chosen",
    "tiles_of",
]

INTEGRATORS = ("path", "direct", "whitted", "ao")
SAMPLERS = ("sobol", "independent")
FILTERS = ("blackman-harris", "tent", "box")
SAMPLINGS = ("mis", "light", "bsdf", "uniform", "mixture")
HEURISTICS = ("power", "balance")
LIGHT_CHOICES = ("tree", "power", "uniform")
MISTAKES = ("", "light-cutoff", "attenuation")
PROJECTIONS = ("perspective", "orthographic", "panorama")
MAX_SIZE = 16384
MAX_DEPTH = 1024
MAX_LIGHT_SAMPLES = 64
MAX_FLOOR = 0.95  # what a path goes on with at most: renderer/kernel/integrators/path.py
MAX_FILM_EXPONENT = 24
MAX_DISTANCE = 1e15  # squares and products of it stay within float32
MAX_RADIANCE = 1e9
MAX_SPP = 1 << 20  # with the film's exponent, keeps every int64 sum below 2**62: see renderer/film.py

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class View:
    """A camera: world-space `eye` and `target`, and an `up` hint; lengths in the scene's unit.

    projection: perspective, with the vertical field of view `fov` in degrees; orthographic, showing `height` units from top
    to bottom; or panorama, all directions around the eye as an equirectangular picture (`fov` unused).
    aperture: radius of the thin lens of a perspective camera; 0: a pinhole, sharp everywhere.
    focus: distance along the line of sight of the plane that is sharp; None: the target's.
    near: distance along the line of sight where rays start, but a panorama's: what stands before is cut away.
    """

    eye: Vec3
    target: Vec3
    up: Vec3 = (0.0, 1.0, 0.0)
    fov: float = 40.0
    projection: str = "perspective"
    aperture: float = 0.0
    focus: float | None = None
    height: float = 2.0
    near: float = 0.0

    def __post_init__(self) -> None:
        if not 0.01 <= self.fov <= 179.0:
            raise SettingsError(f"fov is {self.fov:g}; a vertical field of view lies between 0.01 and 179 degrees")
        if self.projection not in PROJECTIONS:
            raise SettingsError(f"projection is {self.projection!r}; known are {', '.join(PROJECTIONS)}")
        if not 0.0 <= self.aperture <= MAX_DISTANCE:
            raise SettingsError(f"aperture is {self.aperture:g}; a lens's radius lies between 0 and 1e15")
        if self.focus is not None and not 1e-12 <= self.focus <= MAX_DISTANCE:
            raise SettingsError(f"focus is {self.focus:g}; a distance to focus at lies between 1e-12 and 1e15")
        if not 1e-12 <= self.height <= MAX_DISTANCE:
            raise SettingsError(f"height is {self.height:g}; what an orthographic camera shows lies between 1e-12 and 1e15")
        if not 0.0 <= self.near <= MAX_DISTANCE:
            raise SettingsError(f"near is {self.near:g}; a distance to start rays at lies between 0 and 1e15")
        for name in ("eye", "target", "up"):
            if not all(math.isfinite(c) and abs(c) <= MAX_DISTANCE for c in getattr(self, name)):
                raise SettingsError(f"{name} is {getattr(self, name)}; its coordinates lie between -1e15 and 1e15")
        if all(abs(e - t) < 1e-12 for e, t in zip(self.eye, self.target, strict=True)):
            raise SettingsError("eye and target are the same point; move one of them")
        d = [t - e for e, t in zip(self.eye, self.target, strict=True)]
        u = self.up
        cross = (d[1] * u[2] - d[2] * u[1], d[2] * u[0] - d[0] * u[2], d[0] * u[1] - d[1] * u[0])
        if sum(c * c for c in cross) <= 1e-12 * sum(c * c for c in d) * max(sum(c * c for c in u), 1e-300):
            raise SettingsError("up points along the line of sight (or is zero); give another up direction")

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> View:
        """The view that `dataclasses.asdict` made JSON of. Raises SettingsError where it cannot be."""
        fields: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in data.items()}
        return cls(**fields)


@dataclass(frozen=True)
class RenderSettings:
    """Everything but the scene that a sample's colour depends on.

    max_depth: path segments, the camera's included (1 = only what the camera sees emit).
    sampler: where a path's numbers come from (renderer/kernel/sampling/sampler.py).
    filter: the pixel filter, sampled by its own shape, so that a sample belongs to one pixel alone.
    sampling: how the path tracer finds lights: mis, or one strategy alone (light, bsdf, uniform), to compare them; mixture aims
    at lights and marked things without shadow rays (renderer/kernel/integrators/mixture.py).
    heuristic: how mis weighs the two strategies (Veach 1997): power, of the second, or balance.
    light_choice: by what chance a light is taken of many: tree, by what it may give the point that is lit; power, by its power
    alone; uniform, each as often as the others.
    clamp_indirect: the most that light of more than one bounce may add to a channel at each vertex of a path, its hue kept;
    0: no limit, no bias.
    roulette: the constant probability with which paths go on after each bounce; 0: by their throughput, after three.
    roulette_floor: where it goes by throughput, the least probability that a path goes on with.
    light_samples: shadow rays at the camera's first hit; of whitted, the points a light is sampled at, 1 being its middle.
    ao_distance: how far ambient occlusion looks, in scene units; 0: to infinity.
    ambient: linear RGB radiance that whitted adds to all that is diffuse, for lack of indirect light.
    mistake: an error of other renderers, to show what it does to a picture: light-cutoff (a light's sample is dropped where
    1/d^2 < 0.001, though all samples are divided by), attenuation (radiance falls by 1/d^2 once more). "": none.
    environment: linear RGB radiance that replaces the scene's own environment, or None to keep it.
    environment_strength: factor on the scene's (or the replaced) environment.
    environment_rotation: degrees by which it is turned about +Y, counter-clockwise seen from above.
    film_exponent: the film's quantum is 2**-film_exponent (see renderer/film.py).
    """

    width: int
    height: int
    view: View
    max_depth: int = 8
    seed: int = 0
    integrator: str = "path"
    sampler: str = "sobol"
    filter: str = "blackman-harris"
    sampling: str = "mis"
    heuristic: str = "power"
    light_choice: str = "tree"
    clamp_indirect: float = 0.0
    roulette: float = 0.0
    roulette_floor: float = 0.0
    light_samples: int = 1
    ao_distance: float = 0.0
    ambient: Vec3 = (0.0, 0.0, 0.0)
    mistake: str = ""
    environment: Vec3 | None = None
    environment_strength: float = 1.0
    environment_rotation: float = 0.0
    film_exponent: int = 24

    def __post_init__(self) -> None:
        object.__setattr__(self, "ambient", tuple(self.ambient))
        for name in ("width", "height"):
            if not 1 <= getattr(self, name) <= MAX_SIZE:
                raise SettingsError(f"{name} is {getattr(self, name)}; it lies between 1 and {MAX_SIZE}")
        if not 1 <= self.max_depth <= MAX_DEPTH:
            raise SettingsError(f"max_depth is {self.max_depth}; it lies between 1 and {MAX_DEPTH}")
        if not 0 <= self.seed < 1 << 32:
            raise SettingsError(f"seed is {self.seed}; it lies between 0 and 2**32 - 1")
        for name, known in (
            ("integrator", INTEGRATORS),
            ("sampler", SAMPLERS),
            ("filter", FILTERS),
            ("sampling", SAMPLINGS),
            ("heuristic", HEURISTICS),
            ("light_choice", LIGHT_CHOICES),
            ("mistake", MISTAKES),
        ):
            if getattr(self, name) not in known:
                listed = ", ".join(k or "none at all" for k in known)
                raise SettingsError(f"{name} is {getattr(self, name)!r}; known are {listed}")
        if not 0.0 <= self.clamp_indirect <= MAX_RADIANCE:
            raise SettingsError(f"clamp_indirect is {self.clamp_indirect:g}; it lies between 0 (off) and 1e9")
        if self.roulette != 0 and not 0.05 <= self.roulette <= 1.0:
            raise SettingsError(
                f"roulette is {self.roulette:g}; a probability to go on lies between 0.05 and 1, or is 0: by throughput"
            )
        if not 0.0 <= self.roulette_floor <= MAX_FLOOR:
            raise SettingsError(f"roulette_floor is {self.roulette_floor:g}; it lies between 0 (none) and {MAX_FLOOR}")
        if not 1 <= self.light_samples <= MAX_LIGHT_SAMPLES:
            raise SettingsError(f"light_samples is {self.light_samples}; it lies between 1 and {MAX_LIGHT_SAMPLES}")
        if not 0.0 <= self.ao_distance <= MAX_DISTANCE:
            raise SettingsError(f"ao_distance is {self.ao_distance:g}; it lies between 0 (no limit) and 1e15")
        if not all(0.0 <= c <= MAX_RADIANCE for c in self.ambient):
            raise SettingsError(f"ambient is {self.ambient}; its radiances lie between 0 and 1e9")
        if self.environment is not None and not all(0.0 <= c <= MAX_RADIANCE for c in self.environment):
            raise SettingsError(f"environment is {self.environment}; its radiances lie between 0 and 1e9")
        if not 0 <= self.film_exponent <= MAX_FILM_EXPONENT:
            raise SettingsError(f"film_exponent is {self.film_exponent}; it lies between 0 and {MAX_FILM_EXPONENT}")
        if not -360.0 <= self.environment_rotation <= 360.0:
            raise SettingsError(f"environment_rotation is {self.environment_rotation:g}; it lies between -360 and 360 degrees")
        if not 0.0 <= self.environment_strength <= 1e6:
            raise SettingsError(f"environment_strength is {self.environment_strength:g}; it lies between 0 and 1e6")

    def to_json(self) -> dict[str, Any]:
        """A JSON-ready dict; `from_json` gives the same settings back to the bit."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> RenderSettings:
        """The settings that `to_json` wrote, of this release or an older one. Raises SettingsError where it cannot be."""
        optional = {field.name for field in fields(cls) if field.default is None}
        data = {name: value for name, value in data.items() if value is not None or name in optional}
        view = View.from_json(data.pop("view"))
        for name in ("environment", "ambient"):
            if isinstance(data.get(name), list):
                data[name] = tuple(data[name])
        try:
            return cls(view=view, **data)
        except TypeError as error:
            raise SettingsError(f"these settings are of another release of Rayfarm ({error})") from None


# What a request may leave to the scene file, and the scene file to the defaults.
OPTIONAL = tuple(
    field.name
    for field in fields(RenderSettings)
    if field.default is not MISSING and not field.name.startswith(("environment", "film"))
)


def chosen(asked: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The optional settings that are asked for, and of the others those that the scene file's `defaults` hold."""
    both = {name: asked.get(name) if asked.get(name) is not None else defaults.get(name) for name in OPTIONAL}
    return {name: value for name, value in both.items() if value is not None}


class Tile(NamedTuple):
    """A rectangle of a frame, in pixels; (0, 0) is the frame's upper left corner."""

    x: int
    y: int
    w: int
    h: int


def tiles_of(width: int, height: int, size: int) -> list[Tile]:
    """The tiles of a frame in reading order; those at the right and lower edge may be smaller."""
    return [
        Tile(x, y, min(size, width - x), min(size, height - y)) for y in range(0, height, size) for x in range(0, width, size)
    ]
