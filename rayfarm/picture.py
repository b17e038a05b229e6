"""The options that describe a picture, shared by `render` and `submit`.

Generated from the renderer's declarations of settings.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import typer

from rayfarm import options
from rayfarm.declared_options import parameter, typed_settings
from rayfarm.errors import CommandError
from renderer.errors import SettingsError
from renderer.formats import UP_AXES
from renderer.lens_distortion import LensDistortion
from renderer.presets import PRESETS
from renderer.scene.animation.shutter import SHUTTER
from renderer.setting_declaration import DeclaredSetting
from renderer.settings import ENVIRONMENT, OPTIONAL, SETTINGS, VIEW, RenderSettings, View, chosen
from renderer.work import DEFAULT_SIZE, WORK

__all__ = ["Picture", "takes_picture"]

SETTINGS_OPTIONS: Mapping[str, DeclaredSetting] = {name: SETTINGS[name] for name in OPTIONAL}
ENVIRONMENT_OPTIONS: Mapping[str, DeclaredSetting] = {
    name: each for name, each in ENVIRONMENT.items() if name != "color"
}  # given by --env
LIMIT_OPTIONS: Mapping[str, DeclaredSetting] = {name: WORK[name] for name in ("spp", "noise", "seconds")}


def _composite_option(name: str, help: str, panel: str, metavar: str) -> inspect.Parameter:
    """Returns an option that does not correspond to a single setting. Its value is a text, or None if it is not given."""
    option = typer.Option(f"--{name}", help=help, rich_help_panel=panel, metavar=metavar)
    return inspect.Parameter(
        name.replace("-", "_"), inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[str | None, option]
    )


def _floor() -> inspect.Parameter:
    """Returns the option for the studio's floor: True, False, or None if it is not given."""
    help = "A floor that takes the scene's shadows; by default if neither the file nor --env has light."
    option = typer.Option("--floor/--no-floor", help=help, rich_help_panel="Environment", show_default=False)
    return inspect.Parameter("floor", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[bool | None, option])


def _parameters() -> list[inspect.Parameter]:
    """Returns all options of a picture, for a command's signature."""
    return [
        _composite_option(
            "size", f"Pixels; what the scene asks for, else {DEFAULT_SIZE[0]}x{DEFAULT_SIZE[1]}.", "Size and quality", "WxH"
        ),
        *map(parameter, LIMIT_OPTIONS.values()),
        _composite_option("camera", "A camera of the scene, by name or number from 0.", "View", "NAME|N"),
        *map(parameter, VIEW.values()),
        _composite_option(
            "distortion",
            "The lens's distortion, with OpenCV's coefficients: brown,k1,k2,p1,p2,k3,k4,k5,k6 or fisheye,k1,k2,k3,k4.",
            "View",
            "MODEL,K1,...",
        ),
        _composite_option(
            "up-axis",
            f"The axis of an OBJ, PLY, STL or OFF file that is up: {', '.join(UP_AXES)}; by default a guess.",
            options.FILE_PANEL,
            "AXIS",
        ),
        _composite_option(
            "env",
            "Replaces the scene's environment: by an equirectangular .exr or .hdr, a linear colour R,G,B, a clear sky "
            f"sky:E,A by the sun's elevation and azimuth in degrees, or a preset: {', '.join(PRESETS)}.",
            "Environment",
            "LIGHT",
        ),
        _floor(),
        *map(parameter, ENVIRONMENT_OPTIONS.values()),
        *map(parameter, SETTINGS_OPTIONS.values()),
    ]


@dataclass
class Picture:
    """The picture options on the command line: values by option name; None or missing if not given."""

    given: Mapping[str, Any] = field(default_factory=dict)

    @property
    def spp(self) -> int | None:
        """Samples per pixel; None if not given."""
        return self.given.get("spp")

    @property
    def noise(self) -> float | None:
        """Relative noise at which rendering ends; None if not given."""
        return self.given.get("noise")

    @property
    def time_limit(self) -> float | None:
        """Seconds after which rendering ends; None if not given."""
        return self.given.get("time_limit")

    @property
    def camera(self) -> str | None:
        """Name or number of one of the scene's cameras; None if not given."""
        return self.given.get("camera")

    def environment(self) -> options.Env:
        """Returns the environment from --env."""
        return options.environment_of(self.given.get("env"))

    def placement(self) -> options.Placement:
        """Returns the options for the up axis and the floor.

        Without a floor option, a floor is added only under the studio light, not if --env is given.
        """
        default = options.AUTO if self.environment() == options.Env() else None
        asked = self.given.get("floor")
        floor = default if asked is None else "on" if asked else None
        return options.Placement(options.parse_up_axis(self.given.get("up_axis")), floor)

    def floor_notes(self, has_floor: bool) -> list[str]:
        """Returns a list with the note about a floor that was added without an option; empty without such a floor."""
        is_default = has_floor and self.given.get("floor") is None
        return ["A floor takes the scene's shadows; --no-floor leaves it out."] if is_default else []

    def given_settings(self) -> dict[str, Any]:
        """Returns the optional settings by the renderer's names; None if not given."""
        return typed_settings(SETTINGS_OPTIONS, self.given)

    def check(self) -> None:
        """Raises CommandError for values that are invalid for every scene. Called before an upload."""
        self._size()
        self.environment()
        self.placement()
        parse_distortion(self.given.get("distortion"))
        for options_of in (SETTINGS_OPTIONS, LIMIT_OPTIONS, ENVIRONMENT_OPTIONS, VIEW):
            typed_settings(options_of, self.given)

    def changes_view(self) -> bool:
        """Returns True if options change the view, beyond selecting one of the scene's cameras."""
        return any(value is not None for value in self._view().values())

    def changes_view_partly(self) -> bool:
        """Returns True if options change the view without setting both its position and its target."""
        return self.changes_view() and (self.given.get("eye") is None or self.given.get("target") is None)

    def view(self, cameras: list[dict[str, Any]]) -> View:
        """Returns the view of the selected camera (default: the first), with the options applied."""
        return self._changed_view(cameras[options.find_camera(cameras, self.given.get("camera"))]["view"])

    def views(self, cameras: list[dict[str, Any]]) -> tuple[View, ...]:
        """Returns the camera's views while the shutter is open, with the options applied; empty for a static camera."""
        views = tuple(map(self._changed_view, cameras[options.find_camera(cameras, self.given.get("camera"))].get("views", ())))
        return views if any(view != views[0] for view in views) else ()

    def _changed_view(self, start: dict[str, Any]) -> View:
        changes = {name: value for name, value in self._view().items() if value is not None}
        try:
            return View.from_json({**start, **changes})
        except SettingsError as error:
            raise CommandError(f"This view cannot be rendered: {error}.") from error

    def settings(self, cameras: list[dict[str, Any]], defaults: dict[str, Any]) -> RenderSettings:
        """Returns the render settings. Raises CommandError or SettingsError."""
        own = (defaults.get("width", DEFAULT_SIZE[0]), defaults.get("height", DEFAULT_SIZE[1]))
        width, height = self._size() or own
        light = {each.name: value for name, each in ENVIRONMENT_OPTIONS.items() if (value := self._light()[name]) is not None}
        return RenderSettings(
            width=width,
            height=height,
            view=self.view(cameras),
            views=self.views(cameras),
            environment=self.environment().color,
            **light,
            **chosen(self.given_settings(), defaults),
        )

    def camera_options(self) -> dict[str, Any]:
        """Returns the given camera options by option name."""
        named = {each.option: self.given.get(each.option.replace("-", "_")) for each in VIEW.values()}
        named["distortion"] = self.given.get("distortion")
        return {name: value for name, value in {"camera": self.given.get("camera"), **named}.items() if value is not None}

    def shutter(self) -> dict[str, Any]:
        """Returns the given shutter settings."""
        return {name: value for name, value in self.given_settings().items() if name in SHUTTER and value is not None}

    def request(self, cameras: list[dict[str, Any]]) -> dict[str, Any]:
        """Returns the body of the request POST /api/jobs."""
        width, height = self._size() or (None, None)
        environment = {"color": self.environment().color, **self._light()}
        if (sky := self.environment().sky) is not None:
            environment["sky"] = {"elevation": sky[0], "azimuth": sky[1]}
        environment["preset"] = self.environment().preset
        asked: dict[str, Any] = {
            **self.given_settings(),
            **typed_settings(LIMIT_OPTIONS, self.given),
            "width": width,
            "height": height,
        }
        asked["environment"] = {name: value for name, value in environment.items() if value is not None}
        if self.changes_view():
            asked["view"] = self.view(cameras).to_json()
        elif self.given.get("camera") is not None:
            # By number, since cameras of a file may share a name.
            asked["camera"] = options.find_camera(cameras, self.given["camera"])
        return {name: value for name, value in asked.items() if value is not None}

    def _size(self) -> tuple[int, int] | None:
        return options.parse_size(self.given["size"]) if self.given.get("size") else None

    def _light(self) -> dict[str, Any]:
        return typed_settings(ENVIRONMENT_OPTIONS, self.given)

    def _view(self) -> dict[str, Any]:
        return {**typed_settings(VIEW, self.given), "distortion": parse_distortion(self.given.get("distortion"))}


def parse_distortion(given: Any) -> LensDistortion | None:
    """Returns the lens distortion of the option's text MODEL,K1,..., or of a mapping. Raises SettingsError."""
    if not isinstance(given, str):
        return LensDistortion.parse(given)
    model, *numbers = given.split(",")
    try:
        return LensDistortion(model.strip(), tuple(map(float, numbers)))
    except ValueError:
        raise CommandError(f"--distortion is {given!r}; it takes a model and numbers, such as brown,-0.2,0.05.") from None


def _panel_place(each: inspect.Parameter) -> int:
    """Returns the place of a parameter's panel in the help; -1 for arguments, and for options without a panel."""
    panels = [option.rich_help_panel for option in getattr(each.annotation, "__metadata__", ())]
    return options.PANELS.index(panels[0]) if any(panels) else -1


def takes_picture(command: Callable[..., Any]) -> Callable[..., None]:
    """Decorator that replaces a command's parameter `picture` (a Picture) by all picture options.

    Orders the parameters by the panels of the help.
    """
    added = _parameters()

    @functools.wraps(command)
    def run(**given: Any) -> None:
        picture = Picture({each.name: given.pop(each.name) for each in added})
        command(picture=picture, **given)

    own = inspect.signature(command, eval_str=True).parameters.values()
    place = [each.name for each in own].index("picture")
    kept = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in own]
    taken = sorted([*kept[:place], *added, *kept[place + 1 :]], key=_panel_place)
    setattr(run, "__signature__", inspect.Signature(taken))  # noqa: B010
    run.__annotations__ = {each.name: each.annotation for each in taken}
    del run.__wrapped__  # otherwise the signature of `command` would be used
    return run
