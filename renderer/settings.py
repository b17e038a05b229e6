"""The settings of an image: the view, the size, and everything else on which a sample's colour depends.

`RenderSettings` declares all inputs of a sample's colour besides the scene (renderer/setting_declaration.py).
Plain data without numpy, so that the service and the client can create and check it without the kernel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, MISSING, asdict, dataclass
from typing import Annotated, Any, NamedTuple

from renderer.errors import SettingsError
from renderer.sentences import Sentence
from renderer.setting_declaration import Choices, Setting, SettingTexts, checked, table
from renderer.view import MAX_DISTANCE, PROJECTIONS, VIEW, Vec3, View

__all__ = [
    "BACKGROUNDS",
    "CAUSTICS",
    "ENVIRONMENT",
    "FILTERS",
    "GUIDING",
    "HEURISTICS",
    "INTEGRATORS",
    "LIGHT_CHOICES",
    "LIGHT_PATHS",
    "MAX_CAUSTIC_TRIALS",
    "MAX_DEPTH",
    "MAX_FLOOR",
    "MAX_LIGHT_GROUPS",
    "MAX_LIGHT_SAMPLES",
    "MAX_SHUTTER",
    "MAX_SIZE",
    "MAX_SPLITTING",
    "MAX_SPP",
    "MISTAKES",
    "MOST_KEYS",
    "OPTIONAL",
    "PATH",
    "PROJECTIONS",
    "REST_GROUP",
    "SAMPLERS",
    "SAMPLINGS",
    "SETTINGS",
    "SHUTTERS",
    "VIEW",
    "RenderSettings",
    "Tile",
    "Vec3",
    "View",
    "check_light_groups",
    "chosen",
    "group_names",
    "light_planes",
    "tiles_of",
]

INTEGRATORS = Choices(
    {
        "path": SettingTexts("Path tracing", "All light: direct, reflected, refracted, from wall to wall."),
        "direct": SettingTexts("Direct light", "Light that comes straight from a light; what it would bounce on to stays dark."),
        "whitted": SettingTexts("Whitted ray tracing", "Direct light, mirrors and glass, as in 1980; matt walls light nothing."),
        "ao": SettingTexts("Ambient occlusion", "How open each point is to its surroundings; lights and colours play no part."),
    }
)
SAMPLERS = Choices(
    {
        "sobol": SettingTexts("Sobol, scrambled", "Evenly spread samples: the least noise for their number."),
        "independent": SettingTexts("Independent", "Plain random numbers, to compare with."),
    }
)
FILTERS = Choices(
    {
        "blackman-harris": SettingTexts("Blackman-Harris", "Smooth edges without ringing."),
        "tent": SettingTexts("Tent", "A little crisper."),
        "box": SettingTexts("Box", "Every sample counts the same within its pixel: crisp, with stairs."),
    }
)
SAMPLINGS = Choices(
    {
        "mis": SettingTexts("Both, weighted (MIS)", "Lights and surfaces are both sampled, each counts where it is good."),
        "light": SettingTexts("Lights only", "Good for small lights; mirrors do not see them."),
        "bsdf": SettingTexts("Surfaces only", "Lights are found by chance: good for large ones and for mirrors."),
        "uniform": SettingTexts("Uniform", "All directions alike: the most noise, for comparison."),
        "mixture": SettingTexts("Mixture", "Half by the surface, half aimed at lights and at spheres that guide: for caustics."),
    }
)
HEURISTICS = Choices(
    {
        "power": SettingTexts("Power heuristic", "The better strategy's samples count the more."),
        "balance": SettingTexts("Balance heuristic", "By how often either would have taken the sample."),
    }
)
LIGHT_CHOICES = Choices(
    {
        "tree": SettingTexts("By what they give", "Near, strong and facing lights are taken more often: a light tree."),
        "power": SettingTexts("By power", "Strong lights are taken more often, wherever they are."),
        "uniform": SettingTexts("Uniform", "Each as often as the others, for comparison."),
    }
)
SHUTTERS = Choices(
    {
        "centred": SettingTexts("Centred", "Open as long before the frame's time as after it."),
        "trailing": SettingTexts("Trailing", "It closes at the frame's time."),
        "leading": SettingTexts("Leading", "It opens at the frame's time."),
    }
)
MISTAKES = Choices(
    {
        "": SettingTexts("None", "Other renderers' errors, to see what each does to a picture."),
        "light-cutoff": SettingTexts(
            "Lights cut off by distance", "Far light samples are dropped but still counted: the picture darkens."
        ),
        "attenuation": SettingTexts(
            "Attenuation twice", "Radiance falls by the squared distance once more: the picture darkens."
        ),
    }
)
BACKGROUNDS = Choices(
    {
        "visible": SettingTexts("Visible", "The environment and suns are seen behind the scene."),
        "transparent": SettingTexts("Transparent", "The picture has an alpha channel; the environment still lights the scene."),
    }
)
CAUSTICS = Choices(
    {
        "off": SettingTexts("Off", "Light through glass and water is found by chance."),
        "on": SettingTexts("On", "Small lamps and suns are sought through smooth glass, water and mirrors: sharp caustics."),
    }
)
GUIDING = Choices(
    {
        "off": SettingTexts("Off", "Paths follow surfaces and lights alone."),
        "on": SettingTexts("On", "Pilot paths learn first where light comes from: for light through water and glass."),
    }
)
LIGHT_PATH_CHOICES = Choices(
    {
        "off": SettingTexts("Off", "The picture alone, with its other planes."),
        "on": SettingTexts("On", "Ten images more, which add up to the picture: DiffDir, GlossInd and so on."),
    }
)
MAX_CAUSTIC_TRIALS = 4096  # walks that estimate the probability of one: renderer/kernel/manifold/estimate.py
MAX_SIZE = 16384
MAX_DEPTH = 1024
MAX_LIGHT_SAMPLES = 64
MAX_SPLITTING = 2
MAX_SHUTTER = 64.0  # frames
MOST_KEYS = 65  # keys of a shutter
MAX_FLOOR = 0.95  # maximum of the least survival probability: renderer/kernel/steps/continue_or_end.py
MAX_FILM_EXPONENT = 24
MAX_RADIANCE = 1e9
MAX_LIGHT_GROUPS = 16  # by name; with that of other lights, as many as renderer/film.py allows
MOST_RANKS = 16  # of Cryptomatte: renderer/cryptomatte.py
LIGHT_PATHS = (  # the planes by light path, behind those of light groups: renderer/kernel/light_paths.py
    "emission",
    "environment",
    "diffuse_direct",
    "diffuse_indirect",
    "glossy_direct",
    "glossy_indirect",
    "transmission_direct",
    "transmission_indirect",
    "volume_direct",
    "volume_indirect",
)
PATH = "path:"  # begins the names of a film's planes by light path; no light group's name has a colon
REST_GROUP = "rest"  # of lights in none of these groups
MAX_SPP = 1 << 20  # with the film's exponent, keeps every int64 sum below 2**62: see renderer/film.py

_estimating = ("path", "direct")
_lit = ("path", "direct", "whitted")


@dataclass(frozen=True)
class RenderSettings:
    """All inputs of a sample's colour except the scene. Each field's annotation describes it.

    film_exponent: the film's quantum is 2**-film_exponent. environment: linear RGB radiance; None for the scene's own. mistake: a
    deliberate error: light-cutoff omits a light sample where 1/d^2 < 0.001; attenuation multiplies radiance by a further 1/d^2.
    sampling: see renderer/kernel/lineage/mixture.py; heuristic: Veach 1997. views: of a moving camera, at equal steps from
    shutter opening to closing.
    """

    width: Annotated[int, Setting(1, MAX_SIZE), SettingTexts("Width", "Pixels.", "px", "basic", "Size and quality")]
    height: Annotated[int, Setting(1, MAX_SIZE), SettingTexts("Height", "Pixels.", "px", "basic", "Size and quality")]
    view: View
    _: KW_ONLY
    integrator: Annotated[
        str, Setting(choices=INTEGRATORS), SettingTexts("Integrator", "How light is traced.", group="basic")
    ] = "path"
    max_depth: Annotated[
        int,
        Setting(1, MAX_DEPTH),
        SettingTexts(
            "Max depth",
            "Path segments, the camera's included: 1 shows only what emits.",
            integrators=("path", "whitted"),
            phrase="depth {}",
            usual=(1, 64),
        ),
    ] = 8
    transmission_depth: Annotated[
        int,
        Setting(1, MAX_DEPTH, off=0),
        SettingTexts(
            "Transmission depth",
            "Transmissions of a path through glass and panes; smooth ones do not use up max depth.",
            integrators=("path",),
            off=Sentence("setting-off-depth", "all count as depth"),
            phrase="transmission {}",
        ),
    ] = MAX_DEPTH
    diffuse_depth: Annotated[
        int,
        Setting(1, MAX_DEPTH, off=0),
        SettingTexts(
            "Diffuse depth",
            "Diffuse bounces of a path; max depth is the total.",
            integrators=("path",),
            off=Sentence("setting-off-max-depth", "as many as max depth"),
            phrase="diffuse {}",
        ),
    ] = 0
    glossy_depth: Annotated[
        int,
        Setting(1, MAX_DEPTH, off=0),
        SettingTexts(
            "Glossy depth",
            "Mirrored and glossy bounces of a path; max depth is the total.",
            integrators=("path",),
            off=Sentence("setting-off-max-depth", "as many as max depth"),
            phrase="glossy {}",
        ),
    ] = 0
    transparency_depth: Annotated[
        int,
        Setting(1, MAX_DEPTH, off=0),
        SettingTexts(
            "Transparency depth",
            "Surfaces that a path passes by their alpha, with its shadow rays; more of them block light.",
            off=Sentence("setting-off-no-limit", "no limit"),
            phrase="transparency {}",
        ),
    ] = 0
    sampling: Annotated[
        str,
        Setting(choices=SAMPLINGS),
        SettingTexts(
            "Finding lights",
            "Where paths look for light; all agree in the end, and differ in noise.",
            group="lab",
            integrators=_estimating,
        ),
    ] = "mis"
    heuristic: Annotated[
        str,
        Setting(choices=HEURISTICS),
        SettingTexts("Weighed by", "How mis weighs what lights and what surfaces sample.", group="lab", integrators=_estimating),
    ] = "power"
    light_choice: Annotated[
        str,
        Setting(choices=LIGHT_CHOICES),
        SettingTexts(
            "Choice among lights", "How one light is chosen among many.", group="lab", integrators=_lit, phrase="lights: {}"
        ),
    ] = "tree"
    light_samples: Annotated[
        int,
        Setting(1, MAX_LIGHT_SAMPLES),
        SettingTexts(
            "Light samples",
            "Shadow rays where the camera looks; of whitted, 1 is a sharp shadow.",
            integrators=_lit,
            usual=(1, 16),
        ),
    ] = 1
    caustics: Annotated[
        str,
        Setting(choices=CAUSTICS),
        SettingTexts(
            "Caustics",
            "Whether small lamps are sought through one or two smooth interfaces of glass, water and mirrors.",
            integrators=("path",),
            phrase="caustics {}",
        ),
    ] = "off"
    guiding: Annotated[
        str,
        Setting(choices=GUIDING),
        SettingTexts(
            "Guiding",
            "Whether paths follow a map of where light comes from, learned before the image is rendered.",
            integrators=("path",),
            phrase="guiding {}",
        ),
    ] = "off"
    splitting: Annotated[
        int,
        Setting(1, MAX_SPLITTING),
        SettingTexts("Splitting", "Branches that a path has behind its first vertex.", group="lab", integrators=_estimating),
    ] = MAX_SPLITTING
    roulette: Annotated[
        float,
        Setting(0.05, 1.0, off=0.0),
        SettingTexts(
            "Roulette",
            "The chance of a path to continue at each bounce; otherwise it depends on what the path still carries.",
            group="lab",
            integrators=_estimating,
            off=Sentence("setting-off-throughput", "by throughput"),
        ),
    ] = 0.0
    roulette_floor: Annotated[
        float,
        Setting(0.0, MAX_FLOOR, off=0.0),
        SettingTexts(
            "Least chance",
            "The least chance of a path to continue, if that depends on what it carries.",
            group="lab",
            integrators=("path",),
            off=Sentence("setting-off-none", "none"),
            usual=(0.0, MAX_FLOOR),
            phrase="floor {}",
        ),
    ] = 0.0
    clamp_indirect: Annotated[
        float,
        Setting(0.0, MAX_RADIANCE, off=0.0),
        SettingTexts(
            "Indirect clamp",
            "The most that bounced light adds at each vertex: cuts fireflies, and some light with them.",
            integrators=("path",),
            off=Sentence("setting-off-off", "off"),
            option="clamp",
            phrase="clamp {}",
        ),
    ] = 0.0
    ao_distance: Annotated[
        float,
        Setting(0.0, MAX_DISTANCE, off=0.0),
        SettingTexts(
            "AO distance",
            "What is farther away than this, in scene units, does not occlude.",
            unit="scene units",
            integrators=("ao",),
            off=Sentence("setting-off-no-limit", "no limit"),
            phrase="AO {}",
        ),
    ] = 0.0
    ambient: Annotated[
        Vec3,
        Setting(0.0, MAX_RADIANCE),
        SettingTexts(
            "Ambient light",
            "A constant in place of all light that surfaces give each other.",
            unit="radiance",
            integrators=("whitted",),
            phrase="ambient {}",
        ),
    ] = (0.0, 0.0, 0.0)
    mistake: Annotated[
        str,
        Setting(choices=MISTAKES),
        SettingTexts(
            "Mistake on purpose",
            "An error of other renderers, to show what it does to a picture.",
            group="lab",
            integrators=_lit,
            phrase="mistake: {}",
        ),
    ] = ""
    background: Annotated[
        str,
        Setting(choices=BACKGROUNDS),
        SettingTexts(
            "Background",
            "What is seen where no object is.",
            integrators=_estimating,
            section="Samples",
            phrase="background {}",
        ),
    ] = "visible"
    filter: Annotated[
        str, Setting(choices=FILTERS), SettingTexts("Pixel filter", "How wide a pixel looks.", section="Samples")
    ] = "blackman-harris"
    sampler: Annotated[
        str, Setting(choices=SAMPLERS), SettingTexts("Sampler", "Where random numbers come from.", group="lab", section="Samples")
    ] = "sobol"
    seed: Annotated[
        int,
        Setting(0, (1 << 32) - 1),
        SettingTexts("Seed", "Another seed, another noise; the same seed, the same bits.", section="Samples"),
    ] = 0
    shutter: Annotated[
        float,
        Setting(0.001, MAX_SHUTTER, off=0.0),
        SettingTexts(
            "Shutter",
            "How long the shutter is open, as a fraction of a frame's time: what moves meanwhile is blurred.",
            unit="fraction",
            section="Samples",
            off=Sentence("setting-off-no-blur", "no motion blur"),
            phrase="shutter {}",
            usual=(0.0, 1.0),
        ),
    ] = 0.0
    shutter_at: Annotated[
        str, Setting(choices=SHUTTERS), SettingTexts("Shutter at", "When it is open.", section="Samples", phrase="shutter {}")
    ] = "centred"
    shutter_keys: Annotated[
        int,
        Setting(2, MOST_KEYS, off=0),
        SettingTexts(
            "Shutter keys",
            "How many times motion is sampled while the shutter is open; between two of them nothing may turn by half a turn.",
            section="Samples",
            off=Sentence("setting-off-turns", "as often as its turns need"),
            phrase="{} keys",
        ),
    ] = 0
    light_groups: Annotated[
        str,
        Setting(names=MAX_LIGHT_GROUPS),
        SettingTexts(
            "Light groups",
            "Groups of lights that get images of their own, by name; these add up to the picture.",
            integrators=_estimating,
            phrase="light groups {}",
        ),
    ] = ""
    light_paths: Annotated[
        str,
        Setting(choices=LIGHT_PATH_CHOICES),
        SettingTexts(
            "Light paths",
            "Images of diffuse, glossy, transmitted and volume light, direct and indirect, of emission and environment.",
            integrators=_estimating,
            phrase="light paths {}",
        ),
    ] = "off"
    cryptomatte: Annotated[
        int,
        Setting(1, MOST_RANKS, off=0),
        SettingTexts(
            "Cryptomatte",
            "Mattes of objects and materials: how many of them a pixel may have in the file, usually 6.",
            section="Samples",
            off=Sentence("setting-off-none", "none"),
            phrase="Cryptomatte {}",
        ),
    ] = 0
    environment: Annotated[
        Vec3 | None,
        Setting(0.0, MAX_RADIANCE, of="environment"),
        SettingTexts(
            "Environment",
            "One colour from all around, in place of the scene's own.",
            unit="radiance",
            section="Environment",
            off=Sentence("setting-off-scene", "the scene's own"),
            phrase="environment: {}",
        ),
    ] = None
    environment_strength: Annotated[
        float,
        Setting(0.0, 1e6, of="environment"),
        SettingTexts(
            "Strength",
            "A factor on the light from all around.",
            section="Environment",
            option="env-strength",
            phrase="light around × {}",
            usual=(0.0, 4.0),
        ),
    ] = 1.0
    environment_rotation: Annotated[
        float,
        Setting(-360.0, 360.0, of="environment"),
        SettingTexts(
            "Rotation",
            "Of the light from all around, about +Y: counter-clockwise seen from above.",
            unit="°",
            section="Environment",
            option="env-rotation",
            phrase="turned {}°",
            usual=(-180.0, 180.0),
        ),
    ] = 0.0
    film_exponent: Annotated[
        int, Setting(0, MAX_FILM_EXPONENT, of=""), SettingTexts("Film exponent", "Of the film's quantum.")
    ] = 24
    views: tuple[View, ...] = ()

    def __post_init__(self) -> None:
        checked(self)
        object.__setattr__(self, "views", tuple(self.views))
        if REST_GROUP in self.light_groups.split(","):
            raise SettingsError(
                Sentence(
                    "light-group-reserved",
                    "light_groups names {name}, which is the group of all other lights; leave it out, it is there anyway",
                    name=REST_GROUP,
                ),
                field="light_groups",
            )
        if self.light_groups and self.integrator not in _estimating:
            raise SettingsError(
                Sentence(
                    "light-groups-integrator",
                    "light_groups needs the integrator path or direct; {integrator} has no light groups",
                    integrator=self.integrator,
                ),
                field="light_groups",
            )
        if self.has_light_paths and self.integrator not in _estimating:
            raise SettingsError(
                Sentence(
                    "light-paths-integrator",
                    "light_paths needs the integrator path or direct; {integrator} has no light paths",
                    integrator=self.integrator,
                ),
                field="light_paths",
            )
        if self.has_light_paths and self.caustics == "on":
            raise SettingsError(
                Sentence("light-paths-caustics", "light_paths cannot be combined with caustics 'on' yet; leave out one of them"),
                field="light_paths",
            )
        if self.is_transparent and self.integrator not in _estimating:
            raise SettingsError(
                Sentence(
                    "background-integrator",
                    "background 'transparent' needs the integrator path or direct; {integrator} has no alpha",
                    integrator=self.integrator,
                ),
                field="background",
            )
        if self.light_groups and self.caustics == "on":
            raise SettingsError(
                Sentence(
                    "light-groups-caustics", "light_groups cannot be combined with caustics 'on' yet; leave out one of them"
                ),
                field="light_groups",
            )
        if self.guiding == "on" and self.caustics == "on":
            raise SettingsError(
                Sentence("guiding-caustics", "guiding cannot be combined with caustics 'on' yet; leave out one of them"),
                field="guiding",
            )
        if len(self.views) == 1 or len(self.views) > MOST_KEYS:
            raise SettingsError(
                Sentence(
                    "views-count-wrong",
                    "views has {count} views; a moving camera needs 2 to {most}, a fixed one none",
                    count=len(self.views),
                    most=MOST_KEYS,
                )
            )
        if any(view.projection != self.view.projection for view in self.views):
            raise SettingsError(
                Sentence("views-projections-differ", "views have different projections, which cannot be interpolated; use one")
            )

    @property
    def group_names(self) -> tuple[str, ...]:
        """Returns the names of the film's light groups; the last is REST_GROUP, of all other lights. Empty without groups."""
        return group_names(self.light_groups)

    @property
    def has_light_paths(self) -> bool:
        """Returns True if the film has planes by light path."""
        return self.light_paths == "on"

    @property
    def light_planes(self) -> tuple[str, ...]:
        """Returns the names of the film's planes by light: its light groups, then its light paths; see `light_planes`."""
        return light_planes(self.light_groups, self.light_paths)

    @property
    def is_transparent(self) -> bool:
        """Returns True if the background is transparent, so that the film has an alpha plane."""
        return self.background == "transparent"

    def to_json(self) -> dict[str, Any]:
        """Returns a JSON-ready dict, from which `from_json` restores settings with the same bits.

        The settings of `_LATER` (added in later releases) are omitted if they have their defaults, so that older workers can
        render them.
        """
        told = {**asdict(self), "view": self.view.to_json(), "views": tuple(view.to_json() for view in self.views)}
        return {name: value for name, value in told.items() if name not in _LATER or value != SETTINGS[name].default}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> RenderSettings:
        """Returns the settings of a dict from `to_json` of this release or an older one.

        Raises SettingsError if it is invalid.
        """
        known = {
            name: value
            for name, value in data.items()
            if value is not None or name not in SETTINGS or SETTINGS[name].optional  # null of older releases: the default
        }
        try:
            views = tuple(map(View.from_json, known.pop("views", ())))
            return cls(view=View.from_json(known.pop("view")), views=views, **known)
        except (TypeError, KeyError) as error:
            raise SettingsError(
                Sentence(
                    "settings-release-mismatch",
                    "these settings come from another release of Rayfarm ({error})",
                    error=error,
                )
            ) from None


SETTINGS = table(RenderSettings)
_LATER = ("caustics", "guiding", "transparency_depth", "light_groups", "light_paths", "background", "cryptomatte")

# Settings with defaults in the scene file, and then in RenderSettings.
OPTIONAL = tuple(name for name, each in SETTINGS.items() if each.setting.of == "job" and each.default is not MISSING)

# Settings by their names in a request's environment.
ENVIRONMENT = {
    "color" if name == "environment" else name.removeprefix("environment_"): each
    for name, each in SETTINGS.items()
    if each.setting.of == "environment"
}


def group_names(light_groups: str) -> tuple[str, ...]:
    """Returns the names of a film's light groups, RenderSettings.group_names, for the setting `light_groups`."""
    return (*light_groups.split(","), REST_GROUP) if light_groups else ()


def light_planes(light_groups: str, light_paths: str) -> tuple[str, ...]:
    """Returns the names of a film's planes by light for these settings: light groups, then PATH and each light path."""
    return (*group_names(light_groups), *(f"{PATH}{name}" for name in LIGHT_PATHS if light_paths == "on"))


def check_light_groups(light_groups: str, known: Sequence[str]) -> None:
    """Raises SettingsError if the setting `light_groups` names a group of no light. known: the groups of the scene's lights."""
    unknown = [name for name in group_names(light_groups)[:-1] if name not in known]
    if not unknown:
        return
    if not known:
        text = Sentence(
            "light-groups-none",
            "light_groups names {name}, but no light of the scene has a light_group; set it in the scene's file",
            name=unknown[0],
        )
    else:
        text = Sentence(
            "light-group-unknown",
            "light_groups names {name}, which no light of the scene has; it has {known}",
            name=unknown[0],
            known=[*known],
        )
    raise SettingsError(text, field="light_groups")


def chosen(asked: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the values of the optional settings: from the request where it sets them, else from the scene file's `defaults`.

    asked: the request's settings.
    """
    both = {name: asked.get(name) if asked.get(name) is not None else defaults.get(name) for name in OPTIONAL}
    return {name: value for name, value in both.items() if value is not None}


class Tile(NamedTuple):
    """A rectangle of a frame, in pixels; (0, 0) is the frame's upper left corner."""

    x: int
    y: int
    w: int
    h: int


def tiles_of(width: int, height: int, size: int) -> list[Tile]:
    """Returns the tiles of a frame in reading order. Tiles at the right and lower edge may be smaller."""
    return [
        Tile(x, y, min(size, width - x), min(size, height - y)) for y in range(0, height, size) for x in range(0, width, size)
    ]
