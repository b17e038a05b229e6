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
    "ROLLING_SHUTTERS",
    "SAMPLERS",
    "SAMPLINGS",
    "SETTINGS",
    "SHUTTERS",
    "SPECTRAL",
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
        "path": SettingTexts("Path tracing", "Full lighting: direct light, bounced light, reflections and refractions."),
        "direct": SettingTexts("Direct light", "Only light that arrives straight from a light source; no bounced light."),
        "whitted": SettingTexts(
            "Whitted ray tracing", "Classic ray tracing: direct light, mirrors and glass; matte surfaces do not light each other."
        ),
        "ao": SettingTexts(
            "Ambient occlusion", "Grey picture in which corners and contacts are dark; lights and materials are ignored."
        ),
    }
)
SAMPLERS = Choices(
    {
        "sobol": SettingTexts("Sobol, scrambled", "Evenly distributed samples: the least noise."),
        "independent": SettingTexts("Independent", "Random samples: more noise, for comparison."),
    }
)
FILTERS = Choices(
    {
        "blackman-harris": SettingTexts("Blackman-Harris", "Smooth edges without halos."),
        "tent": SettingTexts("Tent", "Slightly sharper edges."),
        "box": SettingTexts("Box", "Sharpest, but edges look stepped."),
    }
)
SAMPLINGS = Choices(
    {
        "mis": SettingTexts(
            "Both, weighted (MIS)", "Samples lights and surfaces and combines both: the least noise in most scenes."
        ),
        "light": SettingTexts("Lights only", "Samples lights only: good for small lights, but mirrors do not show them."),
        "bsdf": SettingTexts(
            "Surfaces only", "Samples surfaces only: good for large lights and mirrors, noisy with small lights."
        ),
        "uniform": SettingTexts("Uniform", "Samples all directions equally: the most noise, for comparison."),
        "mixture": SettingTexts(
            "Mixture", "Half of the rays follow the surface, half aim at lights and guide spheres: for caustics."
        ),
    }
)
HEURISTICS = Choices(
    {
        "power": SettingTexts("Power heuristic", "Strongly prefers the strategy with less noise: the usual choice."),
        "balance": SettingTexts("Balance heuristic", "Weights each strategy by how likely it was to take the sample."),
    }
)
LIGHT_CHOICES = Choices(
    {
        "tree": SettingTexts("By contribution", "Prefers lights that are near, bright and face the surface (light tree)."),
        "power": SettingTexts("By power", "Prefers bright lights, however far away."),
        "uniform": SettingTexts("Uniform", "All lights equally often, for comparison."),
    }
)
SHUTTERS = Choices(
    {
        "centred": SettingTexts("Centred", "The frame's time is the middle of the exposure."),
        "trailing": SettingTexts("Trailing", "The exposure ends at the frame's time."),
        "leading": SettingTexts("Leading", "The exposure starts at the frame's time."),
    }
)
ROLLING_SHUTTERS = Choices(
    {
        "top": SettingTexts("From the top", "The top row is read out first."),
        "bottom": SettingTexts("From the bottom", "The bottom row is read out first."),
        "left": SettingTexts("From the left", "The left column is read out first, as on a phone held upright."),
        "right": SettingTexts("From the right", "The right column is read out first."),
    }
)
MISTAKES = Choices(
    {
        "": SettingTexts("None", "The correct picture."),
        "light-cutoff": SettingTexts("Lights cut off by distance", "Ignores light from far away: the picture gets too dark."),
        "attenuation": SettingTexts("Attenuation twice", "Light fades with distance twice: the picture gets too dark."),
    }
)
BACKGROUNDS = Choices(
    {
        "visible": SettingTexts("Visible", "Shows the environment and the sun behind the objects."),
        "transparent": SettingTexts(
            "Transparent", "Saves an alpha channel instead of a background; the environment still lights the objects."
        ),
    }
)
CAUSTICS = Choices(
    {
        "off": SettingTexts("Off", "Light focused by glass and water stays noisy or is missing."),
        "on": SettingTexts("On", "Clear, sharp light patterns from small lamps and the sun."),
    }
)
SPECTRAL = Choices(
    {
        "off": SettingTexts("RGB", "Light has three channels: red, green and blue."),
        "on": SettingTexts("Spectral", "Light has wavelengths: glass makes rainbows, metals and saturated colours are exact."),
    }
)
GUIDING = Choices(
    {
        "off": SettingTexts("Off", "Ordinary path tracing."),
        "auto": SettingTexts("Auto", "Learns first, and uses what it has learned only where that reduces the noise."),
        "on": SettingTexts("On", "Less noise in light through water and glass; learning takes a moment first."),
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
MOST_DEEP = 64  # renderer/deep.py
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
        str, Setting(choices=INTEGRATORS), SettingTexts("Integrator", "How lighting is computed.", group="basic")
    ] = "path"
    max_depth: Annotated[
        int,
        Setting(1, MAX_DEPTH),
        SettingTexts(
            "Max depth",
            "Longest light path, in segments. Higher is brighter in interiors and glass, and slower.",
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
            "Most passes through glass. Through smooth glass they do not count towards max depth.",
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
            "Most bounces off matte surfaces, within max depth.",
            integrators=("path",),
            off=Sentence("setting-off-max-depth", "as max depth"),
            phrase="diffuse {}",
        ),
    ] = 0
    glossy_depth: Annotated[
        int,
        Setting(1, MAX_DEPTH, off=0),
        SettingTexts(
            "Glossy depth",
            "Most bounces off mirrors and glossy surfaces, within max depth.",
            integrators=("path",),
            off=Sentence("setting-off-max-depth", "as max depth"),
            phrase="glossy {}",
        ),
    ] = 0
    transparency_depth: Annotated[
        int,
        Setting(1, MAX_DEPTH, off=0),
        SettingTexts(
            "Transparency depth",
            "Most transparent (alpha) surfaces that light passes, such as leaves; further ones block it.",
            off=Sentence("setting-off-no-limit", "no limit"),
            phrase="transparency {}",
        ),
    ] = 0
    sampling: Annotated[
        str,
        Setting(choices=SAMPLINGS),
        SettingTexts(
            "Light sampling",
            "How light sources are found. The final picture is the same, only the noise differs.",
            group="lab",
            integrators=_estimating,
        ),
    ] = "mis"
    heuristic: Annotated[
        str,
        Setting(choices=HEURISTICS),
        SettingTexts(
            "MIS heuristic",
            "How samples of lights and of surfaces are weighted against each other.",
            group="lab",
            integrators=_estimating,
        ),
    ] = "power"
    light_choice: Annotated[
        str,
        Setting(choices=LIGHT_CHOICES),
        SettingTexts(
            "Light selection",
            "Which light is sampled where there are several.",
            group="lab",
            integrators=_lit,
            phrase="lights: {}",
        ),
    ] = "tree"
    light_samples: Annotated[
        int,
        Setting(1, MAX_LIGHT_SAMPLES),
        SettingTexts(
            "Light samples",
            "Shadow rays at what the camera sees: more, smoother soft shadows. With Whitted, 1 gives sharp shadows.",
            integrators=_lit,
            usual=(1, 16),
        ),
    ] = 1
    caustics: Annotated[
        str,
        Setting(choices=CAUSTICS),
        SettingTexts(
            "Caustics",
            "Clear patterns of light that glass, water and mirrors focus, from small lamps and the sun.",
            integrators=("path",),
            phrase="caustics {}",
        ),
    ] = "off"
    guiding: Annotated[
        str,
        Setting(choices=GUIDING),
        SettingTexts(
            "Guiding",
            "Learns before rendering where light comes from, for less noise in difficult light.",
            integrators=("path",),
            phrase="guiding {}",
        ),
    ] = "off"
    spectral: Annotated[
        str,
        Setting(choices=SPECTRAL),
        SettingTexts(
            "Spectral",
            "Whether light is rendered by wavelength: for dispersion, metals and saturated colours that light each other.",
            integrators=_estimating,
            phrase="spectral {}",
        ),
    ] = "off"
    splitting: Annotated[
        int,
        Setting(1, MAX_SPLITTING),
        SettingTexts("Splitting", "Paths that continue from each point the camera sees.", group="lab", integrators=_estimating),
    ] = MAX_SPLITTING
    roulette: Annotated[
        float,
        Setting(0.05, 1.0, off=0.0),
        SettingTexts(
            "Roulette",
            "Chance that a path continues at each bounce; by default lower the less light it carries.",
            group="lab",
            integrators=_estimating,
            off=Sentence("setting-off-throughput", "by throughput"),
        ),
    ] = 0.0
    roulette_floor: Annotated[
        float,
        Setting(0.0, MAX_FLOOR, off=0.0),
        SettingTexts(
            "Minimum chance",
            "Lowest chance that a path continues, if that depends on its light.",
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
            "Brightness limit of bounced light: removes fireflies (bright dots), but also some light.",
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
            "Only surfaces nearer than this darken a point.",
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
            "Constant brightness in place of bounced light.",
            unit="radiance",
            integrators=("whitted",),
            phrase="ambient {}",
        ),
    ] = (0.0, 0.0, 0.0)
    mistake: Annotated[
        str,
        Setting(choices=MISTAKES),
        SettingTexts(
            "Deliberate error",
            "Shows what an error of some renderers does to a picture.",
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
            "What is shown behind the objects.",
            integrators=_estimating,
            section="Samples",
            phrase="background {}",
        ),
    ] = "visible"
    filter: Annotated[
        str,
        Setting(choices=FILTERS),
        SettingTexts("Pixel filter", "How samples are blended into pixels: softer or sharper edges.", section="Samples"),
    ] = "blackman-harris"
    sampler: Annotated[
        str, Setting(choices=SAMPLERS), SettingTexts("Sampler", "How samples are distributed.", group="lab", section="Samples")
    ] = "sobol"
    seed: Annotated[
        int,
        Setting(0, (1 << 32) - 1),
        SettingTexts("Seed", "Changes the noise pattern. The same seed gives exactly the same picture again.", section="Samples"),
    ] = 0
    shutter: Annotated[
        float,
        Setting(0.001, MAX_SHUTTER, off=0.0),
        SettingTexts(
            "Shutter",
            "Exposure time relative to a frame's duration: longer blurs motion more. Half is a 180° shutter.",
            unit="fraction",
            section="Samples",
            off=Sentence("setting-off-no-blur", "no motion blur"),
            phrase="shutter {}",
            usual=(0.0, 1.0),
        ),
    ] = 0.0
    shutter_at: Annotated[
        str,
        Setting(choices=SHUTTERS),
        SettingTexts(
            "Shutter position",
            "Whether the exposure lies before, around or after the frame's time.",
            section="Samples",
            phrase="shutter {}",
        ),
    ] = "centred"
    shutter_keys: Annotated[
        int,
        Setting(2, MOST_KEYS, off=0),
        SettingTexts(
            "Shutter keys",
            "Time steps of motion blur. Use more for fast rotation: nothing may turn by half a turn in one step.",
            section="Samples",
            off=Sentence("setting-off-turns", "as often as its turns need"),
            phrase="{} keys",
        ),
    ] = 0
    rolling_shutter: Annotated[
        float,
        Setting(0.001, 1.0, off=0.0),
        SettingTexts(
            "Rolling shutter",
            "Share of the shutter's time in which rows are read out one after the other. All: each is exposed for an instant.",
            unit="fraction",
            section="Samples",
            off=Sentence("setting-off-all-at-once", "all at once"),
            phrase="rolling shutter {}",
            usual=(0.0, 1.0),
        ),
    ] = 0.0
    rolling_shutter_from: Annotated[
        str,
        Setting(choices=ROLLING_SHUTTERS),
        SettingTexts(
            "Readout",
            "Edge of the picture at which a rolling shutter begins.",
            section="Samples",
            phrase="rolling shutter {}",
        ),
    ] = "top"
    light_groups: Annotated[
        str,
        Setting(names=MAX_LIGHT_GROUPS),
        SettingTexts(
            "Light groups",
            "Names of light groups whose brightness and colour can be changed after rendering.",
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
            "Masks of objects and materials in the EXR: how many per pixel, usually 6.",
            section="Samples",
            off=Sentence("setting-off-none", "none"),
            phrase="Cryptomatte {}",
        ),
    ] = 0
    deep: Annotated[
        int,
        Setting(4, MOST_DEEP, off=0),
        SettingTexts(
            "Deep samples",
            "Samples in depth for a deep EXR: how many per pixel at most, usually 32.",
            section="Samples",
            off=Sentence("setting-off-none", "none"),
            phrase="deep samples {}",
        ),
    ] = 0
    environment: Annotated[
        Vec3 | None,
        Setting(0.0, MAX_RADIANCE, of="environment"),
        SettingTexts(
            "Environment",
            "One even colour all around in place of the scene's environment.",
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
            "Brightness of the environment; 1 leaves it as it is.",
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
            "Turns the environment about the vertical axis (+Y), counter-clockwise seen from above.",
            unit="°",
            section="Environment",
            option="env-rotation",
            phrase="turned {}°",
            usual=(-180.0, 180.0),
        ),
    ] = 0.0
    film_exponent: Annotated[
        int,
        Setting(0, MAX_FILM_EXPONENT, of=""),
        SettingTexts("Film exponent", "Precision of stored sums: the quantum is 2 to the power of minus this."),
    ] = 24
    views: tuple[View, ...] = ()

    def __post_init__(self) -> None:
        checked(self)
        object.__setattr__(self, "views", tuple(self.views))
        if self.rolling_shutter and not self.shutter:
            raise SettingsError(
                Sentence(
                    "rolling-shutter-closed",
                    "rolling_shutter needs a shutter; set shutter to the part of a frame's time in which all rows are read out",
                ),
                field="rolling_shutter",
            )
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
        if self.guiding != "off" and self.caustics == "on":
            raise SettingsError(
                Sentence("guiding-caustics", "guiding cannot be combined with caustics 'on' yet; leave out one of them"),
                field="guiding",
            )
        if self.is_spectral:
            self._check_spectral()
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

    def _check_spectral(self) -> None:
        """Raises SettingsError if a setting cannot be combined with `spectral`."""
        if self.integrator not in _estimating:
            raise SettingsError(
                Sentence(
                    "spectral-integrator",
                    "spectral needs the integrator path or direct; {integrator} renders in RGB only",
                    integrator=self.integrator,
                ),
                field="spectral",
            )
        others = {
            "caustics": self.caustics == "on",
            "guiding": self.guiding != "off",
        }
        for name, is_used in others.items():
            if is_used:
                raise SettingsError(
                    Sentence(
                        "spectral-combination",
                        "spectral cannot be combined with the setting {setting} yet; leave out one of them",
                        setting=name,
                    ),
                    field="spectral",
                )

    @property
    def is_spectral(self) -> bool:
        """Returns True if light is rendered by wavelength."""
        return self.spectral == "on"

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
_LATER = (
    *("caustics", "guiding", "transparency_depth", "light_groups", "light_paths", "background", "cryptomatte", "deep"),
    *("rolling_shutter", "rolling_shutter_from", "spectral"),
)

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
