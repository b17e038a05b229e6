"""`rayfarm render`: renders pictures in this process, without a farm."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rayfarm import options
from rayfarm.console import err
from rayfarm.errors import EXIT_FAILED, CommandError
from rayfarm.frame import PictureOrder, camera_options, moment_options, motion_of, render_to, report_bad_samples, statistics
from rayfarm.graphics_card import open_card
from rayfarm.movie import render_movie
from rayfarm.output_files import check_still_size, check_writable
from rayfarm.picture import Picture, takes_picture
from rayfarm.reading import open_stage
from rayfarm.rendering import Clock, load_kernels, load_scene, show_progress
from rayfarm.replay import show_path
from rayfarm.sequence import Sequence, check_outputs, render_sequence
from rayfarm.strict import refuse_warnings
from renderer import aovs
from renderer.cuda.cards import NOT_YET_TRIED
from renderer.denoise import is_available
from renderer.formats import SCENE_SUFFIXES
from renderer.frames import parse_frames
from renderer.image.ocio import curve_of
from renderer.image.tonemap import CURVES, key_of
from renderer.printable import printable
from renderer.scene.animation import Moment
from renderer.settings import RenderSettings
from service.watching.movie import is_movie

if TYPE_CHECKING:
    from rayfarm.frame import F32
    from renderer.render import RenderStats

__all__ = ["print_darkness_note", "register"]

USUAL = (".glb", ".gltf", ".usdz", ".fbx", ".obj", ".blend", ".yaml")
LINEAR = (".exr", ".hdr")  # not tone mapped


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("render")(render)


@takes_picture
def render(
    scene: Annotated[
        Path,
        typer.Argument(
            help=f"A scene file ({' '.join(USUAL)}, and {len(SCENE_SUFFIXES) - len(USUAL)} other kinds), a folder, or a .zip."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The picture: .png .jpg (tone mapped) .avif .jxl (HDR) .exr .hdr (scene-linear); of several frames also "
            ".mp4 .webm .webp. By default SCENE.png, of several frames SCENE.####.png.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    picture: Picture = Picture(),
    variant: options.Variant = None,
    strict: options.Strict = False,
    root: options.Root = None,
    frame: options.Frame = None,
    frames: options.Frames = None,
    overwrite: options.Overwrite = False,
    fps: options.Fps = None,
    clip: options.Clip = None,
    turntable: options.Turntable = None,
    aov: options.Aov = None,
    denoise: options.Denoise = False,
    exposure: Annotated[
        float, typer.Option(help="Exposure in stops; not for .exr and .hdr.", rich_help_panel=options.OUTPUT)
    ] = 0.0,
    tonemap: Annotated[
        str,
        typer.Option(
            metavar="CURVE",
            help=f"Tone curve; .png and .jpg only: {', '.join(CURVES)}; or a view of an OCIO config, `ocio:VIEW` (rayfarm ocio).",
            rich_help_panel=options.OUTPUT,
        ),
    ] = "neutral",
    ocio: options.Ocio = None,
    gain_map: Annotated[
        bool,
        typer.Option(
            "--gain-map",
            help="Add a gain map to a .jpg (Ultra HDR): HDR displays show brighter highlights, others the same picture.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = False,
    stats: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json", help="Write times and counts there; `-` for the screen.", rich_help_panel=options.OUTPUT
        ),
    ] = None,
    tile: Annotated[
        str | None,
        typer.Option(metavar="X,Y,W,H", help="Only this rectangle; the rest stays black.", rich_help_panel=options.PART),
    ] = None,
    first: Annotated[
        int,
        typer.Option(min=0, help="First sample number, to reproduce a part of a longer render.", rich_help_panel=options.PART),
    ] = 0,
    pixel: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="Trace one path of this pixel again and print its vertices; no picture.",
            rich_help_panel=options.PART,
        ),
    ] = None,
    sample: Annotated[
        int | None, typer.Option(min=0, help="Which of the pixel's samples; by default 0.", rich_help_panel=options.PART)
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the path as JSON, for programs.", rich_help_panel=options.PART)
    ] = False,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Threads; by default one per core.", rich_help_panel=options.MACHINE)
    ] = None,
    gpu: Annotated[
        bool,
        typer.Option(
            "--gpu",
            help=f"Render with the first NVIDIA card instead of the cores, to the same bits; {NOT_YET_TRIED}.",
            rich_help_panel=options.MACHINE,
        ),
    ] = False,
    no_bvh: Annotated[
        bool,
        typer.Option(
            "--no-bvh", help="Test every ray against every triangle: the same picture, slowly.", rich_help_panel=options.MACHINE
        ),
    ] = False,
) -> None:
    """Render a scene to a picture, or a shot to one picture a frame, in this process and on all cores.

    Options replace what the scene file states; defaults hold where it states nothing. Exits with 1 and a sentence if
    anything fails. If one frame of a shot fails, the others are still rendered.

    [bold]Examples[/bold]

      rayfarm render scenes/cornell-box.yaml -o cornell.png
      rayfarm render truck.glb -o truck.png --env studio --denoise
      rayfarm render truck.glb -o truck.exr --size 1920x1080 --spp 256 --aov all
      rayfarm render duck.dae -o duck.png --eye 4,2,4 --target 0,1,0 --fov 35
      rayfarm render shot.glb -o shot.####.exr --frames 0-99 --spp 64
      rayfarm render shot.glb -o shot.mp4 --frames 0-99 --spp 64
      rayfarm render truck.glb -o truck.png --tonemap ocio
      rayfarm render scenes/cornell-box.yaml --pixel 480,270 --sample 3
    """
    moment = Moment(frame or 0.0, fps, clip)
    rectangle = options.parse_tile(tile) if tile else None
    curve = curve_of(tonemap, ocio or "")
    order = PictureOrder(picture, [], denoise, exposure, curve, rectangle, first, turntable, threads, strict, gain_map=gain_map)
    if pixel is not None:
        if gpu:
            raise CommandError("--pixel traces a path on the processor: omit --gpu")
        if frames is not None:
            raise CommandError("--pixel traces a path of one frame: select it by --frame")
        _print_path(scene, variant, moment, order, pixel, sample or 0, no_bvh, as_json, root)
        return
    if output is None:
        output = Path(f"{scene.resolve().stem}{'' if frames is None else '.####'}.png")
    if sample is not None or as_json:
        raise CommandError("--sample and --json need --pixel X,Y")
    if frame is not None and frames is not None:
        raise CommandError("--frame and --frames were both given; --frames 7,9-12 names any of them")
    if gpu:
        order = replace(order, card=open_card())
    if overwrite and frames is None:
        raise CommandError("--overwrite needs --frames; a single picture is always overwritten")
    order = replace(order, planes=_aovs(aov, output))
    shot = None if frames is None else Sequence(scene, parse_frames(frames), output, moment, overwrite)
    _check_output_files(output, shot, order, stats)
    if shot is not None:
        with open_stage(
            *(scene, picture.environment(), variant, picture.camera, no_bvh, threads, picture.shutter(), root),
            placement=picture.placement(),
        ) as stage:
            if is_movie(output):
                about = (picture, variant, turntable, exposure, key_of(curve), tile, first)
                found = render_movie(shot, stage, order, about)
            else:
                found = render_sequence(shot, stage, order)
        if stats is not None:
            _write(stats, found)
        if found["failed"]:
            raise typer.Exit(EXIT_FAILED)
        return
    _render_still(scene, output, order, variant, moment, no_bvh, root, stats)


def _render_still(
    scene: Path,
    output: Path,
    order: PictureOrder,
    variant: str | None,
    moment: Moment,
    no_bvh: bool,
    root: Path | None,
    stats: Path | None,
) -> None:
    picture = order.picture
    clock = Clock()
    import renderer.render  # noqa: F401

    clock.end_step("import_s")
    environment = picture.environment()
    motion: list[F32 | None] = []
    compiled, summary = load_scene(
        *(scene, environment, clock, no_bvh, variant, order.threads, moment, picture.camera, picture.shutter()),
        before=lambda stage: motion.append(motion_of(stage, order, moment, clock)),
        root=root,
        placement=picture.placement(),
    )
    warnings = options.relevant_warnings(summary["warnings"], environment)
    refuse_warnings(scene.name, warnings, order.strict)
    for warning in [*warnings, *picture.floor_notes(summary["floor"])]:
        err.print(f"note: {warning}", markup=False, soft_wrap=True)
    settings = order.settings(summary, moment)
    check_still_size(output, settings.width, settings.height)
    load_kernels(settings, compiled, clock, order.card)
    from renderer.scene.visible_surfaces import INVISIBLE

    is_invisible = any(getattr(each, "code", "") in INVISIBLE for each in summary["warnings"])
    other_camera = "auto" if picture.camera != "auto" and any(each["name"] == "auto" for each in summary["cameras"]) else ""
    with show_progress() as show:
        done = render_to(
            *(output, order, compiled, summary, settings, clock, show, motion[0]),
            on_picture=lambda picture, objects: (
                None if is_invisible else print_darkness_note(picture, objects, output, order.exposure, other_camera)
            ),
        )
    _print_summary(output, settings, clock, done)
    report_bad_samples(scene, settings, done, moment_options(moment) + camera_options(order, settings))
    if stats is not None:
        _write(stats, statistics(clock, done))


def print_darkness_note(picture: F32, objects: F32, output: Path, exposure: float, other_camera: str) -> None:
    """Prints a note if a picture is black, with the reason, or if a tone-mapped one looks black, with an exposure that shows it.

    objects: 1 + the object number of each pixel, 0 for none. other_camera: name of the camera to advise; empty: none.
    """
    from renderer.image.darkness import darkness

    if not picture.any():
        if objects.any():
            why, advice = "no light reaches what the camera sees", "--env studio lights it."
        elif other_camera:
            why, advice = "the camera sees no object", f"--camera {other_camera} frames the scene."
        else:
            why, advice = "the camera sees no object", "`rayfarm info` shows the bounds of the scene, for --eye and --target."
        err.print(f"note: The picture is black: {why}. {advice}", markup=False, soft_wrap=True)
        return
    if output.suffix.lower() in LINEAR or (dark := darkness(picture * 2.0**exposure)) is None:
        return
    brightest = dark.brightest / 2.0**exposure
    err.print(
        f"note: The picture is very dark: its brightest parts have radiance {brightest:.2g}. "
        f"--exposure {exposure + dark.exposure:g} shows it; --env studio lights it.",
        markup=False,
        soft_wrap=True,
    )


def _check_output_files(output: Path, shot: Sequence | None, order: PictureOrder, stats: Path | None) -> None:
    """Raises CommandError, before rendering, if the requested files cannot be written."""
    from renderer.image import encode, hdr_still, tonemap

    if shot is not None:
        check_outputs(shot)
    for path in (*(order.files(output) if shot is None else ()), stats):
        if path is not None and str(path) != "-":
            check_writable(path)
    if order.denoise and not is_available():
        raise CommandError("--denoise needs Open Image Denoise. Install it: pip install 'pyoidn>=2.5,<3'")
    if order.gain_map and (is_movie(output) or encode.format_of(output) != "jpg"):
        raise CommandError("--gain-map is for .jpg; .avif and .jxl have a high dynamic range themselves")
    if order.gain_map:
        tonemap.check_standard_range(order.curve)
    if shot is None or not is_movie(output):
        if encode.format_of(output) in hdr_still.FORMATS:
            tonemap.check_pq(order.curve)
    elif order.denoise:
        raise CommandError(
            "--denoise writes a second picture per frame, which a movie cannot contain: write pictures with -o out.####.png"
        )


def _print_path(
    scene: Path,
    variant: str | None,
    moment: Moment,
    order: PictureOrder,
    pixel: str,
    sample: int,
    no_bvh: bool,
    as_json: bool,
    root: Path | None,
) -> None:
    x, y = options.parse_pixel(pixel)
    environment, camera, shutter = order.picture.environment(), order.picture.camera, order.picture.shutter()
    compiled, summary = load_scene(
        *(scene, environment, Clock(), no_bvh, variant, None, moment, camera, shutter),
        root=root,
        placement=order.picture.placement(),
    )
    refuse_warnings(scene.name, options.relevant_warnings(summary["warnings"], environment), order.strict)
    settings = order.settings(summary, moment)
    if not (x < settings.width and y < settings.height):
        raise CommandError(f"--pixel is {x},{y}; the picture has {settings.width}x{settings.height} pixels, counted from 0")
    load_kernels(settings, compiled, Clock())
    show_path(compiled, settings, summary, x, y, sample, as_json)


def _aovs(text: str | None, output: Path) -> list[str]:
    names = aovs.parse_names((name.strip() for name in text.split(",")), None) if text else []
    if names and output.suffix.lower() != ".exr":
        raise CommandError(f"--aov needs an .exr: {output.suffix} cannot contain further channels")
    return names


def _print_summary(output: Path, settings: RenderSettings, clock: Clock, stats: RenderStats) -> None:
    seconds = max(clock.seconds["render_s"], 1e-9)
    taken = stats.samples / (settings.width * settings.height)
    speed = f"{taken:.4g} spp, {seconds:.1f} s, {stats.samples / seconds / 1e6:.2f} M samples/s"
    err.print(f"{output}: {settings.width}x{settings.height}, {speed}", markup=False, soft_wrap=True)


def _write(path: Path, found: dict[str, Any]) -> None:
    text = json.dumps(found, indent=1)
    if str(path) == "-":
        print(printable(text))
    else:
        path.write_text(text + "\n")
