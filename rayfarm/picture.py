"""The options that say what a picture is, the same for `render` and `submit`: declared once, taken by both."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any, get_type_hints

import typer

from rayfarm import options
from rayfarm.errors import CommandError
from renderer.errors import SettingsError
from renderer.settings import (
    FILTERS,
    HEURISTICS,
    INTEGRATORS,
    LIGHT_CHOICES,
    MAX_DEPTH,
    MAX_FLOOR,
    MAX_LIGHT_SAMPLES,
    MAX_SPP,
    OPTIONAL,
    PROJECTIONS,
    SAMPLERS,
    SAMPLINGS,
    RenderSettings,
    View,
    chosen,
)

__all__ = ["DEFAULT_SPP", "Picture", "takes_picture"]

DEFAULT_SIZE = (960, 540)
DEFAULT_SPP = 64


def _option(panel: str, help: str, *names: str, **more: Any) -> Any:
    return typer.Option(*names, help=help, rich_help_panel=panel, **more)


_size = functools.partial(_option, "Size and quality")
_view = functools.partial(_option, "View")
_light = functools.partial(_option, "Light from all around")
_transport = functools.partial(_option, "How light is followed")
_numbers = functools.partial(_option, "Random numbers and pixels")


@dataclass
class Picture:
    """What a person asks for, as it was typed; None: what the scene asks for, else the renderer's default."""

    size: Annotated[str | None, _size("Pixels; what the scene asks for, else 960x540.", metavar="WxH")] = None
    spp: Annotated[int | None, _size("Samples per pixel; what the scene asks for, else 64.", min=1, max=MAX_SPP)] = None
    noise: Annotated[float | None, _size("Relative noise at which it is good enough, as 0.02.", min=1e-6, max=10.0)] = None
    time_limit: Annotated[float | None, _size("Seconds after which it ends.", metavar="S", min=1e-3)] = None

    camera: Annotated[str | None, _view("A camera of the scene, by name or number from 0.", metavar="NAME|N")] = None
    eye: Annotated[str | None, _view("Where to look from.", metavar="X,Y,Z")] = None
    target: Annotated[str | None, _view("What to look at.", metavar="X,Y,Z")] = None
    up: Annotated[str | None, _view("Which way is up.", metavar="X,Y,Z")] = None
    fov: Annotated[float | None, _view("Vertical field of view, degrees.", metavar="DEG")] = None
    projection: Annotated[
        str | None, _view(f"{', '.join(PROJECTIONS)} (all directions around the eye, equirectangular).", metavar="NAME")
    ] = None
    ortho_height: Annotated[
        float | None, _view("What an orthographic view shows from top to bottom, in scene units.", metavar="LENGTH")
    ] = None
    aperture: Annotated[
        float | None,
        _view("Radius of the lens, in scene units: more blurs what is out of focus; 0: all is sharp.", metavar="LENGTH"),
    ] = None
    focus: Annotated[
        float | None, _view("Distance from the eye at which it is sharp; the target's unless told.", metavar="LENGTH")
    ] = None

    near: Annotated[
        float | None, _view("Distance along the line of sight where rays start: a cut through what is nearer.", metavar="LENGTH")
    ] = None

    env: Annotated[
        str | None,
        _light(
            "An equirectangular .exr or .hdr, a linear colour, or a clear sky with the sun at ELEVATION[,AZIMUTH] degrees. "
            "Replaces the scene's.",
            metavar="FILE|R,G,B|sky:E,A",
        ),
    ] = None
    env_strength: Annotated[float, _light("Factor on it.", min=0.0, max=1e6)] = 1.0

    env_rotation: Annotated[
        float, _light("Degrees by which it is turned, counter-clockwise seen from above.", metavar="DEG", min=-360.0, max=360.0)
    ] = 0.0

    integrator: Annotated[
        str | None,
        _transport(
            f"{', '.join(INTEGRATORS)}: all light; one bounce of it; sharp shadows, mirrors and glass; how open the place is.",
            metavar="NAME",
        ),
    ] = None
    max_depth: Annotated[
        int | None,
        _transport(
            "Path segments, the camera's included (1: only what the camera sees emit); else the scene's, else 8.",
            min=1,
            max=MAX_DEPTH,
        ),
    ] = None
    sampling: Annotated[
        str | None,
        _transport(
            f"{', '.join(SAMPLINGS)}: where paths look for light. All agree in the end; they differ in noise.", metavar="NAME"
        ),
    ] = None
    heuristic: Annotated[
        str | None, _transport(f"{', '.join(HEURISTICS)}: how mis weighs what lights and what surfaces sample.", metavar="NAME")
    ] = None
    light_choice: Annotated[
        str | None,
        _transport(
            f"{', '.join(LIGHT_CHOICES)}: which of many lights is sampled: by what it may give the point, by power, any.",
            metavar="NAME",
        ),
    ] = None
    light_samples: Annotated[
        int | None, _transport("Shadow rays at what the camera sees first.", min=1, max=MAX_LIGHT_SAMPLES)
    ] = None
    roulette: Annotated[
        float | None,
        _transport("Paths go on with this probability, from 0.05 to 1; 0: by what they still carry, after three.", metavar="P"),
    ] = None
    roulette_floor: Annotated[
        float | None, _transport("The least of it where it goes by what they carry.", metavar="P", min=0.0, max=MAX_FLOOR)
    ] = None
    clamp: Annotated[
        float | None,
        _transport(
            "The most that indirect light adds to a sample: fewer fireflies, and a darker picture. 0: off.", metavar="RADIANCE"
        ),
    ] = None
    ao_distance: Annotated[
        float | None, _transport("How far `--integrator ao` looks, in scene units; 0: to infinity.", metavar="LENGTH")
    ] = None

    ambient: Annotated[
        str | None, _transport("Light from all sides that `--integrator whitted` adds, as it follows none.", metavar="R,G,B")
    ] = None
    mistake: Annotated[
        str | None,
        _transport("light-cutoff or attenuation: an error of other renderers, to see what it does.", metavar="NAME"),
    ] = None

    sampler: Annotated[
        str | None,
        _numbers(f"{', '.join(SAMPLERS)}: points that are spread evenly, or plain random ones.", metavar="NAME"),
    ] = None
    filter: Annotated[
        str | None, _numbers(f"{', '.join(FILTERS)}: how wide a pixel looks; box is the sharpest.", metavar="NAME")
    ] = None
    seed: Annotated[int | None, _numbers("Another seed, another noise.", min=0, max=(1 << 32) - 1)] = None

    def environment(self) -> options.Env:
        """Light from all around."""
        return options.environment_of(self.env)

    def asked(self) -> dict[str, Any]:
        """The optional settings by the renderer's names; None where nothing is asked for."""
        ambient = None if self.ambient is None else options.parse_vec3(self.ambient, "--ambient")
        own = {"clamp_indirect": self.clamp, "ambient": ambient}
        return {name: own[name] if name in own else getattr(self, name) for name in OPTIONAL}

    def has_view(self) -> bool:
        """Whether a view of one's own is asked for, and not just one of the scene's cameras."""
        return any(value is not None for value in self._view().values())

    def view(self, cameras: list[dict[str, Any]]) -> View:
        """The chosen camera's view (the first unless told), with what the options change in it."""
        start = cameras[0] if self.camera is None else options.find_camera(cameras, self.camera)
        changes = {name: value for name, value in self._view().items() if value is not None}
        try:
            return View.from_json({**start["view"], **changes})
        except SettingsError as error:
            raise CommandError(f"This view cannot be rendered: {error}.") from error

    def settings(self, cameras: list[dict[str, Any]], defaults: dict[str, Any]) -> RenderSettings:
        """What to render here. Raises CommandError or SettingsError."""
        own = (defaults.get("width", DEFAULT_SIZE[0]), defaults.get("height", DEFAULT_SIZE[1]))
        width, height = options.parse_size(self.size) if self.size else own
        return RenderSettings(
            width=width,
            height=height,
            view=self.view(cameras),
            environment=self.environment().color,
            environment_strength=self.env_strength,
            environment_rotation=self.env_rotation,
            **chosen(self.asked(), defaults),
        )

    def request(self, cameras: list[dict[str, Any]]) -> dict[str, Any]:
        """What POST /api/jobs takes."""
        width, height = options.parse_size(self.size) if self.size else (None, None)
        environment: dict[str, Any] = {
            "color": self.environment().color,
            "strength": self.env_strength,
            "rotation": self.env_rotation,
        }
        if (sky := self.environment().sky) is not None:
            environment["sky"] = {"elevation": sky[0], "azimuth": sky[1]}
        asked: dict[str, Any] = {
            **self.asked(),
            "width": width,
            "height": height,
            "spp": self.spp,
            "noise": self.noise,
            "seconds": self.time_limit,
            "environment": environment,
        }
        if self.has_view():
            asked["view"] = asdict(self.view(cameras))
        elif self.camera is not None:
            asked["camera"] = options.find_camera(cameras, self.camera)["name"]
        return {name: value for name, value in asked.items() if value is not None}

    def _view(self) -> dict[str, Any]:
        vectors = {"eye": self.eye, "target": self.target, "up": self.up}
        return {
            **{name: None if text is None else options.parse_vec3(text, f"--{name}") for name, text in vectors.items()},
            "fov": self.fov,
            "projection": self.projection,
            "height": self.ortho_height,
            "aperture": self.aperture,
            "focus": self.focus,
            "near": self.near,
        }


def takes_picture(command: Callable[..., None]) -> Callable[..., None]:
    """For a command whose parameter `picture` is a Picture: its options take that parameter's place."""
    hints = get_type_hints(Picture, include_extras=True)
    added = [
        inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name])
        for field in fields(Picture)
    ]

    @functools.wraps(command)
    def run(**given: Any) -> None:
        picture = Picture(**{parameter.name: given.pop(parameter.name) for parameter in added})
        command(picture=picture, **given)

    own = inspect.signature(command, eval_str=True).parameters.values()
    place = [parameter.name for parameter in own].index("picture")
    kept = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own]
    taken = [*kept[:place], *added, *kept[place + 1 :]]
    setattr(run, "__signature__", inspect.Signature(taken))  # noqa: B010
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in taken}
    del run.__wrapped__  # else its own signature would count
    return run
