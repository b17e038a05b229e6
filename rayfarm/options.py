"""The options that `render` and `submit` share: one place for their names, their help and how they are read."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from rayfarm.errors import CommandError
from renderer.errors import SettingsError
from renderer.settings import INTEGRATORS, MAX_DEPTH, MAX_SPP, Tile, Vec3, View

__all__ = [
    "Camera",
    "Env",
    "EnvStrength",
    "Eye",
    "Fov",
    "Integrator",
    "MaxDepth",
    "Noise",
    "Output",
    "Seed",
    "Server",
    "Size",
    "Spp",
    "Target",
    "TimeLimit",
    "Up",
    "choose_view",
    "environment_of",
    "find_camera",
    "parse_size",
    "parse_tile",
    "parse_vec3",
]

PANEL_VIEW = "View"
PANEL_QUALITY = "Size and quality"
PANEL_LIGHT = "Light"

Output = Annotated[Path, typer.Option("--output", "-o", help="The picture: .png .jpg (tone mapped) .exr .hdr (scene-linear).")]
Camera = Annotated[
    str | None,
    typer.Option(metavar="NAME|N", help="A camera of the scene, by name or number from 0.", rich_help_panel=PANEL_VIEW),
]
Eye = Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Where to look from.", rich_help_panel=PANEL_VIEW)]
Target = Annotated[str | None, typer.Option(metavar="X,Y,Z", help="What to look at.", rich_help_panel=PANEL_VIEW)]
Up = Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Which way is up.", rich_help_panel=PANEL_VIEW)]
Fov = Annotated[float | None, typer.Option(metavar="DEG", help="Vertical field of view, degrees.", rich_help_panel=PANEL_VIEW)]
Size = Annotated[
    str | None,
    typer.Option(metavar="WxH", help="Pixels; what the scene asks for, else 960x540.", rich_help_panel=PANEL_QUALITY),
]
Spp = Annotated[
    int | None,
    typer.Option(min=1, max=MAX_SPP, help="Samples per pixel; what the scene asks for, else 64.", rich_help_panel=PANEL_QUALITY),
]
MaxDepth = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=MAX_DEPTH,
        help="Path segments, the camera's included (1: only what the camera sees emit); else the scene's, else 8.",
        rich_help_panel=PANEL_QUALITY,
    ),
]
Noise = Annotated[
    float | None,
    typer.Option(min=1e-6, max=10.0, help="Relative noise at which it is good enough, as 0.02.", rich_help_panel=PANEL_QUALITY),
]
TimeLimit = Annotated[
    float | None, typer.Option(metavar="S", min=1e-3, help="Seconds after which it ends.", rich_help_panel=PANEL_QUALITY)
]
Integrator = Annotated[
    str | None, typer.Option(metavar="NAME", help=f"One of: {', '.join(INTEGRATORS)}.", rich_help_panel=PANEL_QUALITY)
]
Seed = Annotated[int, typer.Option(min=0, max=(1 << 32) - 1, help="Another seed, another noise.", rich_help_panel=PANEL_QUALITY)]
Env = Annotated[
    str | None,
    typer.Option(
        metavar="FILE|R,G,B",
        help="Light from all around: an equirectangular .exr or .hdr, or a linear colour. Replaces the scene's.",
        rich_help_panel=PANEL_LIGHT,
    ),
]
EnvStrength = Annotated[
    float, typer.Option(min=0.0, max=1e6, help="Factor on the light from all around.", rich_help_panel=PANEL_LIGHT)
]
Server = Annotated[
    str | None,
    typer.Option(metavar="URL", help="The farm's address; the one running here unless told. [dim]$RAYFARM_SERVER[/dim]"),
]


def parse_vec3(text: str, option: str) -> Vec3:
    """Three finite numbers from `X,Y,Z`."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise CommandError(f"{option} is {text!r}; it takes three numbers as {option} 1,2.5,-3") from None
    if not all(math.isfinite(v) for v in (x, y, z)):
        raise CommandError(f"{option} is {text!r}; its numbers must be finite")
    return x, y, z


def parse_size(text: str) -> tuple[int, int]:
    """Width and height from `WxH`."""
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise CommandError(f"--size is {text!r}; it takes width x height in pixels as --size 1920x1080") from None
    return width, height


def parse_tile(text: str) -> Tile:
    """A rectangle from `X,Y,W,H`."""
    try:
        x, y, w, h = (int(part) for part in text.split(","))
    except ValueError:
        raise CommandError(f"--tile is {text!r}; it takes X,Y,W,H in pixels as --tile 128,64,32,32") from None
    return Tile(x, y, w, h)


def environment_of(text: str | None) -> tuple[Path | None, Vec3 | None]:
    """An environment's image file, or its colour; both None where none is given."""
    if text is None:
        return None, None
    path = Path(text).expanduser()
    if path.is_file():
        return path, None
    if text.count(",") == 2:
        color = parse_vec3(text, "--env")
        if min(color) < 0:
            raise CommandError(f"--env is {text!r}; light cannot be negative")
        return None, color
    raise CommandError(f"--env is {text!r}; there is no such file, and a colour is three numbers as --env 1,1,1")


def find_camera(cameras: list[dict[str, Any]], camera: str) -> dict[str, Any]:
    """The camera of this name, or of this number."""
    names = [c["name"] for c in cameras]
    if camera in names:
        return cameras[names.index(camera)]
    if camera.isdigit() and int(camera) < len(cameras):
        return cameras[int(camera)]
    listed = ", ".join(f"{i}: {name}" for i, name in enumerate(names[:12]))
    raise CommandError(f"The scene has no camera {camera!r}. Its cameras are {listed}.")


def choose_view(
    cameras: list[dict[str, Any]],
    camera: str | None,
    eye: str | None,
    target: str | None,
    up: str | None,
    fov: float | None,
) -> View:
    """The chosen camera's view (the first unless told), with what --eye, --target, --up and --fov change in it."""
    chosen = cameras[0] if camera is None else find_camera(cameras, camera)
    changes: dict[str, Any] = {
        key: parse_vec3(text, f"--{key}") for key, text in (("eye", eye), ("target", target), ("up", up)) if text is not None
    }
    if fov is not None:
        changes["fov"] = fov
    try:
        return View.from_json({**chosen["view"], **changes})
    except SettingsError as error:
        raise CommandError(f"This view cannot be rendered: {error}.") from error
