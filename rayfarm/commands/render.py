"""`rayfarm render`: a picture without a farm, in this process."""

from __future__ import annotations

import json
import resource
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rayfarm import options
from rayfarm.console import err
from rayfarm.errors import CommandError
from rayfarm.output_files import check_writable
from rayfarm.picture import Picture, takes_picture
from rayfarm.rendering import Clock, load_kernels, load_scene, part_of_frame, whole_frame
from rayfarm.replay import show_path
from renderer import aovs
from renderer.denoise import is_available
from renderer.formats import SCENE_SUFFIXES
from renderer.scene.animation import Moment
from renderer.settings import RenderSettings, Tile
from renderer.work import most_samples

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from renderer.film import Sums
    from renderer.render import RenderStats

__all__ = ["register"]

WRITTEN = "What is written"
PART = "A part of it"
HOW = "This machine"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("render")(render)


@takes_picture
def render(
    scene: Annotated[Path, typer.Argument(help=f"A scene file ({' '.join(SCENE_SUFFIXES)}), a folder, or a .zip.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="The picture: .png .jpg (tone mapped) .exr .hdr (scene-linear).", rich_help_panel=WRITTEN
        ),
    ] = None,
    picture: Picture = Picture(),
    variant: options.Variant = None,
    frame: options.Frame = None,
    fps: options.Fps = None,
    clip: options.Clip = None,
    aov: options.Aov = None,
    denoise: options.Denoise = False,
    exposure: Annotated[float, typer.Option(help="Stops; .png and .jpg only.", rich_help_panel=WRITTEN)] = 0.0,
    tonemap: Annotated[
        str, typer.Option(metavar="CURVE", help="Tone curve; .png and .jpg only.", rich_help_panel=WRITTEN)
    ] = "neutral",
    stats: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json", help="Write times and counts there; `-` for the screen.", rich_help_panel=WRITTEN),
    ] = None,
    tile: Annotated[
        str | None,
        typer.Option(metavar="X,Y,W,H", help="Only this rectangle; the rest stays black.", rich_help_panel=PART),
    ] = None,
    first: Annotated[
        int, typer.Option(min=0, help="First sample number, to reproduce a part of a longer render.", rich_help_panel=PART)
    ] = 0,
    pixel: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y", help="Follow one path of this pixel again, and print its vertices. No picture.", rich_help_panel=PART
        ),
    ] = None,
    sample: Annotated[int | None, typer.Option(min=0, help="Which of the pixel's; 0 unless told.", rich_help_panel=PART)] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the path for programs.", rich_help_panel=PART)] = False,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; one per core unless told.", rich_help_panel=HOW)] = None,
    no_bvh: Annotated[
        bool,
        typer.Option("--no-bvh", help="Hold every ray against every triangle: the same picture, slowly.", rich_help_panel=HOW),
    ] = False,
) -> None:
    """Render a scene to a picture, in this process and with all cores.

    [bold]Examples[/bold]

      rayfarm render scenes/cornell-box.yaml -o cornell.png
      rayfarm render truck.glb -o truck.exr --size 1920x1080 --spp 256 --aov albedo,normal --denoise
      rayfarm render duck.dae -o duck.png --eye 4,2,4 --target 0,1,0 --fov 35 --env sky.exr
      rayfarm render scenes/cornell-box.yaml --pixel 480,270 --sample 3
    """
    moment = Moment(frame or 0.0, fps, clip)
    if pixel is not None:
        _replay(scene, variant, moment, picture, pixel, sample or 0, no_bvh, as_json)
        return
    if output is None:
        raise typer.BadParameter("Name the picture to write, or a path to follow by --pixel.", param_hint="'--output' / '-o'")
    if sample is not None or as_json:
        raise CommandError("--sample and --json go with --pixel X,Y")
    planes = _aovs(aov, output)
    rectangle = options.parse_tile(tile) if tile else None
    environment = picture.environment()
    for path in (output, options.denoised_name(output) if denoise else None, stats):
        if path is not None and str(path) != "-":
            check_writable(path)
    if denoise and not is_available():
        raise CommandError("--denoise needs Open Image Denoise. Install it: pip install 'pyoidn>=2.5,<3'")

    clock = Clock()
    from renderer.film import mean
    from renderer.image import encode
    from renderer.image import tonemap as tonemaps
    from renderer.render import RenderStats

    clock.mark("import_s")
    encode.format_of(output)
    if tonemap not in tonemaps.CURVES:
        raise CommandError(f"--tonemap is {tonemap!r}; known are {', '.join(tonemaps.CURVES)}")
    compiled, summary = load_scene(scene, environment, clock, no_bvh, variant, threads, moment)
    for warning in options.told(summary["warnings"], environment):
        err.print(f"note: {warning}", markup=False, soft_wrap=True)

    settings = picture.settings(summary["cameras"], summary["defaults"])
    count = most_samples(picture.spp, picture.noise, picture.time_limit, summary["defaults"])
    done = RenderStats()
    load_kernels(settings, compiled, clock)
    if tile is None and first == 0:
        sums = whole_frame(compiled, settings, count, threads, picture.noise, picture.time_limit, done)
    else:
        sums = part_of_frame(compiled, settings, rectangle or Tile(0, 0, settings.width, settings.height), first, count, done)
    clock.mark("render_s")
    color = mean(sums, settings.film_exponent)
    channels = aovs.layers({name: aovs.values(sums, settings.film_exponent, name) for name in planes})
    encode.write(output, color, exposure=exposure, curve=tonemap, channels=channels)
    if denoise:
        clean = _denoised(sums, settings.film_exponent, threads)
        encode.write(options.denoised_name(output), clean, exposure=exposure, curve=tonemap, channels=channels)
        clock.mark("denoise_s")
    _say(output, scene, settings, clock, done)
    if stats is not None:
        _write_stats(stats, clock, done)


def _replay(
    scene: Path, variant: str | None, moment: Moment, picture: Picture, pixel: str, sample: int, no_bvh: bool, as_json: bool
) -> None:
    x, y = options.parse_pixel(pixel)
    compiled, summary = load_scene(scene, picture.environment(), Clock(), no_bvh, variant, moment=moment)
    settings = picture.settings(summary["cameras"], summary["defaults"])
    if not (x < settings.width and y < settings.height):
        raise CommandError(f"--pixel is {x},{y}; the picture has {settings.width}x{settings.height} pixels, counted from 0")
    load_kernels(settings, compiled, Clock())
    show_path(compiled, settings, summary, x, y, sample, as_json)


def _denoised(sums: Sums, film_exponent: int, threads: int | None) -> npt.NDArray[np.float32]:
    from renderer.denoise import denoise
    from renderer.film import ALBEDO, COLOR, NORMAL, mean

    color, albedo, normal = (mean(sums, film_exponent, channel) for channel in (COLOR, ALBEDO, NORMAL))
    return denoise(color, albedo, normal, threads)


def _aovs(text: str | None, output: Path) -> list[str]:
    names = aovs.known(name.strip() for name in text.split(",")) if text else []
    if names and output.suffix.lower() != ".exr":
        raise CommandError(f"--aov needs an .exr: {output.suffix} has no room for further channels")
    return names


def _say(output: Path, scene: Path, settings: RenderSettings, clock: Clock, done: RenderStats) -> None:
    seconds = max(clock.seconds["render_s"], 1e-9)
    taken = done.samples / (settings.width * settings.height)
    speed = f"{taken:.4g} spp, {seconds:.1f} s, {done.samples / seconds / 1e6:.2f} M samples/s"
    err.print(f"{output}: {settings.width}x{settings.height}, {speed}", markup=False, soft_wrap=True)
    if done.bad_count:
        from worker.reproduce import sample_command

        command = sample_command(settings, *done.bad[0]).replace("SCENE", str(scene), 1)
        err.print(
            f"note: {done.bad_count} samples were not finite and are left out. To follow the first: {command}",
            markup=False,
            soft_wrap=True,
        )


def _write_stats(path: Path, clock: Clock, done: RenderStats) -> None:
    scale = 1 if sys.platform == "darwin" else 1024  # ru_maxrss: bytes there, KiB on Linux
    data = {
        **clock.seconds,
        "render_cpu_s": clock.cpu_seconds["render_s"],
        "samples": done.samples,
        "rays": done.rays,
        "bad_samples": done.bad_count,
        "bad": [bad._asdict() for bad in done.bad],
        "samples_per_s": done.samples / max(clock.seconds["render_s"], 1e-9),
        "peak_memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale,
    }
    text = json.dumps(data, indent=1)
    if str(path) == "-":
        print(text)
    else:
        path.write_text(text + "\n")
