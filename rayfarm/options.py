"""Options shared by several commands, and the parsers of their values."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from rayfarm.errors import CommandError
from renderer.aovs import MOTION, NAMES
from renderer.cameras import camera_number
from renderer.errors import SettingsError
from renderer.formats import UP_AXES
from renderer.presets import PRESETS
from renderer.setting_docs import sentences
from renderer.settings import Tile, Vec3
from renderer.work import SHOT

__all__ = [
    "Aov",
    "Clip",
    "Denoise",
    "Env",
    "Every",
    "Fps",
    "Frame",
    "Frames",
    "Ocio",
    "Order",
    "Overwrite",
    "Placement",
    "Server",
    "Turntable",
    "Variant",
    "deep_name",
    "denoised_name",
    "environment_of",
    "find_camera",
    "parse_pixel",
    "parse_size",
    "parse_tile",
    "parse_up_axis",
    "parse_vec3",
    "relevant_warnings",
]

SKY = "sky:"
AUTO = "auto"

OUTPUT, SHOT_PANEL, FILE_PANEL = "Output", "Animation", "Scene file"
QUEUE, PART, MACHINE, METHODS = "Among other jobs", "A part of the picture", "This machine", "Methods to compare"
# The panels of a command's help, the most used first. "View" to "Samples" are sections of settings.
PANELS = (
    *(OUTPUT, "Size and quality", "Environment", "View", SHOT_PANEL, QUEUE, FILE_PANEL),
    *("Light", "Samples", MACHINE, PART, METHODS),
)

Aov = Annotated[
    str | None,
    typer.Option(
        metavar="NAME,...",
        help=f"Further layers of an .exr: {', '.join(NAMES)}; `all` means all but {MOTION}, which takes a pass of its own.",
        rich_help_panel=OUTPUT,
    ),
]
Denoise = Annotated[
    bool,
    typer.Option(
        "--denoise",
        help="Also write OUT-denoised.EXT, without noise, by Open Image Denoise. A farm's page shows submitted shots "
        "denoised with this option, and stills always, if a worker can denoise.",
        rich_help_panel=OUTPUT,
    ),
]
Ocio = Annotated[
    str | None,
    typer.Option(
        "--ocio",
        metavar="CONFIG",
        help="OCIO config: cg or studio (ACES 2.0), ocio://NAME, or a file; by default $RAYFARM_OCIO, $OCIO, or cg.",
        rich_help_panel=OUTPUT,
    ),
]
Variant = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|N", help="A material variant of a glTF file, by name or number from 0.", rich_help_panel=FILE_PANEL
    ),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict",
        help="Make warnings of the file's reader (what it guesses, drops or replaces) errors: list them and exit with 1.",
        rich_help_panel=FILE_PANEL,
    ),
]
Root = Annotated[
    Path | None,
    typer.Option(
        "--root",
        metavar="DIR",
        help="A folder that has the scene and the files that it refers to outside its own folder.",
        rich_help_panel=FILE_PANEL,
    ),
]
Frame = Annotated[
    float | None,
    typer.Option(metavar="N", help="The frame: frame N shows the time N / fps; by default 0.", rich_help_panel=SHOT_PANEL),
]
Frames = Annotated[
    str | None,
    typer.Option(
        metavar="A-B[xSTEP],...",
        help="Several frames, each in its own file: `-o out.####.exr`. Existing files are kept.",
        rich_help_panel=SHOT_PANEL,
    ),
]
Turntable = Annotated[
    float | None,
    typer.Option(
        min=0.001,
        metavar="SECONDS",
        help="The camera circles its target once in this many seconds.",
        rich_help_panel=SHOT_PANEL,
    ),
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Render frames again whose files exist.", rich_help_panel=SHOT_PANEL)
]
Fps = Annotated[
    float | None,
    typer.Option(
        metavar="F", help="Frames a second; the file's own, else 24. Twice as many: slow motion.", rich_help_panel=SHOT_PANEL
    ),
]
Clip = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|N",
        help="An animation of a glTF file, by name or number from 0, or `all` at once; by default the first.",
        rich_help_panel=SHOT_PANEL,
    ),
]
Order = Annotated[
    str | None, typer.Option(metavar="NAME", help=sentences(SHOT["order"]), rich_help_panel=SHOT_PANEL, show_default=False)
]
Every = Annotated[
    int | None, typer.Option(metavar="N", min=2, max=1024, help=sentences(SHOT["every"]), rich_help_panel=SHOT_PANEL)
]
Server = Annotated[
    str | None,
    typer.Option(metavar="URL", help="The farm's address; by default the one running here. [dim]$RAYFARM_SERVER[/dim]"),
]


def deep_name(output: Path) -> Path:
    """Returns the path of the deep picture, which is in the same folder as the other one."""
    return output.with_name(f"{output.stem}.deep.exr")


def denoised_name(output: Path) -> Path:
    """Returns the path of the denoised picture, which is in the same folder as the raw one."""
    return output.with_name(f"{output.stem}-denoised{output.suffix}")


def parse_vec3(text: str, option: str) -> Vec3:
    """Parses three finite numbers from `X,Y,Z`."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        axis = f". For the axis of a file: --up-axis {text}" if option == "--up" and text.lower() in UP_AXES else ""
        raise CommandError(f"{option} is {text!r}; it takes three numbers as {option} 1,2.5,-3{axis}") from None
    if not all(math.isfinite(v) for v in (x, y, z)):
        raise CommandError(f"{option} is {text!r}; its numbers must be finite")
    return x, y, z


def parse_size(text: str) -> tuple[int, int]:
    """Parses width and height from `WxH`."""
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise CommandError(f"--size is {text!r}; it takes width x height in pixels as --size 1920x1080") from None
    return width, height


def parse_tile(text: str) -> Tile:
    """Parses a rectangle from `X,Y,W,H`."""
    try:
        x, y, w, h = (int(part) for part in text.split(","))
    except ValueError:
        raise CommandError(f"--tile is {text!r}; it takes X,Y,W,H in pixels as --tile 128,64,32,32") from None
    return Tile(x, y, w, h)


def parse_pixel(text: str, option: str = "--pixel") -> tuple[int, int]:
    """Parses a pixel from `X,Y`, with the origin at the upper left."""
    try:
        x, y = (int(part) for part in text.split(","))
    except ValueError:
        x = y = -1
    if min(x, y) < 0:
        raise CommandError(f"{option} is {text!r}; it takes X,Y, counted from the upper left, as {option} 480,270")
    return x, y


class Env(NamedTuple):
    """An environment: an image file, a linear colour, a sky's sun (elevation, azimuth), or a preset's name; at most one is set.

    Presets: renderer/presets.py.
    """

    image: Path | None = None
    color: Vec3 | None = None
    sky: tuple[float, float] | None = None
    preset: str | None = None


class Placement(NamedTuple):
    """The up axis of a scene's file (None: the file's own, or a guess) and the studio's floor.

    floor: "on"; "auto" for scenes without lights; None for none.
    """

    up: str | None = None
    floor: str | None = None


def parse_up_axis(text: str | None) -> str | None:
    """Parses --up-axis; None for `auto`, or if it is not given."""
    axis = None if text is None else text.strip().lower()
    if axis is not None and axis not in (AUTO, *UP_AXES):
        raise CommandError(f"--up-axis is {text!r}; it takes one of {', '.join((AUTO, *UP_AXES))}")
    return None if axis == AUTO else axis


def environment_of(text: str | None) -> Env:
    """Parses --env; all fields are None if it is not given."""
    if text is None:
        return Env()
    if text.startswith(SKY):
        return Env(sky=_sky(text))
    path = Path(text).expanduser()
    if path.is_file():
        return Env(image=path)
    if text in PRESETS:
        return Env(preset=text)
    if text.count(",") == 2:
        color = parse_vec3(text, "--env")
        if min(color) < 0:
            raise CommandError(f"--env is {text!r}; light cannot be negative")
        return Env(color=color)
    raise CommandError(
        f"--env is {text!r}; there is no such file, a colour is three numbers as --env 1,1,1, a sky --env sky:30,120, "
        f"and by name there are {', '.join(PRESETS)}"
    )


def _sky(text: str) -> tuple[float, float]:
    try:
        numbers = [float(part) for part in text.removeprefix(SKY).split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 2 or not -90 <= numbers[0] <= 90 or not abs(numbers[-1]) <= 360:
        raise CommandError(
            f"--env is {text!r}; it takes the sun's elevation, -90 to 90 degrees, and perhaps its azimuth, as --env sky:30,120"
        )
    return numbers[0], numbers[1] if len(numbers) == 2 else 0.0


def relevant_warnings(warnings: list[str], env: Env) -> list[str]:
    """Returns the warnings of a scene that apply to this picture: if --env is given, not those about the default studio light."""
    from renderer.scene.studio import STUDIO_NOTES

    return [w for w in warnings if env == Env() or w not in STUDIO_NOTES]


def find_camera(cameras: list[dict[str, Any]], camera: str | None) -> int:
    """Returns the index of the camera selected by --camera (a name or number); 0 if it is not given. Raises CommandError."""
    try:
        return camera_number([each["name"] for each in cameras], camera)
    except SettingsError as error:
        raise CommandError(f"--{error}.") from None  # it begins with "camera", as the option does
