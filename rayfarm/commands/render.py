"""`rayfarm render`: a picture without a farm, in this process."""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rayfarm import options
from rayfarm.console import Ticker, bar, err
from rayfarm.errors import CommandError
from rayfarm.machine import cores
from rayfarm.scene_files import opened

if TYPE_CHECKING:
    from renderer.film import Sums
    from renderer.scene.compiled import CompiledScene
    from renderer.settings import RenderSettings, Tile

__all__ = ["register"]

AOVS = ("albedo", "normal", "depth")
DEFAULT_SIZE = (960, 540)
DEFAULT_SPP = 64
DEFAULT_DEPTH = 8


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("render")(render)


def render(
    scene: Annotated[Path, typer.Argument(help="A scene file (.yaml .glb .gltf .obj .dae .ply .stl .off), a folder, or a .zip.")],
    output: options.Output,
    camera: options.Camera = None,
    eye: options.Eye = None,
    target: options.Target = None,
    up: options.Up = None,
    fov: options.Fov = None,
    size: options.Size = None,
    spp: options.Spp = None,
    max_depth: options.MaxDepth = None,
    integrator: options.Integrator = None,
    seed: options.Seed = 0,
    env: options.Env = None,
    env_strength: options.EnvStrength = 1.0,
    aov: Annotated[str | None, typer.Option(metavar="NAME,...", help=f"Further channels of an .exr: {', '.join(AOVS)}.")] = None,
    exposure: Annotated[float, typer.Option(help="Stops; .png and .jpg only.")] = 0.0,
    tonemap: Annotated[str, typer.Option(metavar="CURVE", help="Tone curve; .png and .jpg only.")] = "neutral",
    tile: Annotated[str | None, typer.Option(metavar="X,Y,W,H", help="Only this rectangle; the rest stays black.")] = None,
    first: Annotated[int, typer.Option(min=0, help="First sample number, to reproduce a part of a longer render.")] = 0,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; one per core unless told.")] = None,
    stats: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write times and counts there; `-` for the screen.")
    ] = None,
) -> None:
    """Render a scene to a picture, in this process and with all cores.

    [bold]Examples[/bold]

      rayfarm render scenes/cornell-box.yaml -o cornell.png
      rayfarm render truck.glb -o truck.exr --size 1920x1080 --spp 256 --aov albedo,normal
      rayfarm render duck.dae -o duck.png --eye 4,2,4 --target 0,1,0 --fov 35 --env sky.exr
    """
    aovs = _aovs(aov, output)
    width_height = options.parse_size(size) if size else None
    rectangle = options.parse_tile(tile) if tile else None
    environment, color = options.environment_of(env)
    if not output.parent.is_dir():
        raise CommandError(f"There is no folder {output.parent} to write {output.name} to. Make it first.")

    marks = {"begun": time.perf_counter()}
    from renderer.film import mean
    from renderer.image import encode
    from renderer.image import tonemap as tonemaps
    from renderer.render import warm_up
    from renderer.scene.compile import compile_scene, summarise
    from renderer.scene.load import read
    from renderer.settings import RenderSettings

    encode.format_of(output)
    if tonemap not in tonemaps.CURVES:
        raise CommandError(f"--tonemap is {tonemap!r}; known are {', '.join(tonemaps.CURVES)}")
    with bar() as progress:
        step = progress.add_task("reading", total=None)
        marks["imported"] = time.perf_counter()
        with opened(scene, environment) as (folder, main, inside):
            description = read(folder, main, inside)
            marks["loaded"] = time.perf_counter()
            progress.update(step, description="building")
            compiled = compile_scene(description)
        summary = summarise(description, compiled)
        marks["built"] = time.perf_counter()
        progress.update(step, description="compiling")
        warm_up()
        marks["compiled"] = time.perf_counter()
    for warning in summary["warnings"]:
        err.print(f"note: {warning}", markup=False, soft_wrap=True)

    defaults = summary["defaults"]
    width, height = width_height or (defaults.get("width", DEFAULT_SIZE[0]), defaults.get("height", DEFAULT_SIZE[1]))
    settings = RenderSettings(
        width=width,
        height=height,
        view=options.choose_view(summary["cameras"], camera, eye, target, up, fov),
        max_depth=max_depth or defaults.get("max_depth", DEFAULT_DEPTH),
        integrator=integrator or defaults.get("integrator", "path"),
        seed=seed,
        environment=color,
        environment_strength=env_strength,
    )
    count = spp or defaults.get("spp", DEFAULT_SPP)
    sums, samples = _sums(compiled, settings, count, first, rectangle, threads or cores())
    marks["rendered"] = time.perf_counter()
    planes = {name: mean(sums, settings.film_exponent, channel) for name, channel in aovs.items()}
    encode.write(output, mean(sums, settings.film_exponent), exposure=exposure, curve=tonemap, aovs=planes)

    seconds = marks["rendered"] - marks["compiled"]
    speed = samples / max(seconds, 1e-9) / 1e6
    err.print(f"{output}: {width}x{height}, {count} spp, {seconds:.1f} s, {speed:.2f} M samples/s", markup=False, soft_wrap=True)
    if stats is not None:
        _write_stats(stats, marks, samples)


def _sums(
    compiled: CompiledScene, settings: RenderSettings, spp: int, first: int, tile: Tile | None, threads: int
) -> tuple[Sums, int]:
    """The film's sums, and how many samples were taken."""
    import numpy as np

    from renderer.film import CHANNELS
    from renderer.render import render_batch, render_frame

    if tile is not None or first:
        whole = tile or (0, 0, settings.width, settings.height)
        tile = type(tile)(*whole) if tile else _tile(*whole)
        if (
            tile.x < 0
            or tile.y < 0
            or tile.x + tile.w > settings.width
            or tile.y + tile.h > settings.height
            or min(tile.w, tile.h) < 1
        ):
            raise CommandError(f"--tile reaches out of the picture of {settings.width}x{settings.height} pixels")
        part = render_batch(compiled, settings, tile, first, spp)
        sums = np.zeros((CHANNELS, settings.height, settings.width), np.int64)
        sums[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] = part.sums
        return sums, tile.w * tile.h * spp
    ticker = Ticker()
    with bar() as progress:
        task = progress.add_task("rendering", total=None)

        def show(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)
            ticker.tick(f"rendering: {100 * done / max(total, 1):.0f} %")

        sums = render_frame(compiled, settings, spp, threads=threads, progress=show)
    return sums, settings.width * settings.height * spp


def _tile(x: int, y: int, w: int, h: int) -> Tile:
    from renderer.settings import Tile

    return Tile(x, y, w, h)


def _aovs(text: str | None, output: Path) -> dict[str, Any]:
    from renderer.film import ALBEDO, DEPTH, NORMAL

    channels = {"albedo": ALBEDO, "normal": NORMAL, "depth": DEPTH}
    names = [name.strip() for name in text.split(",")] if text else []
    if unknown := [name for name in names if name not in channels]:
        raise CommandError(f"--aov {unknown[0]!r} is not known; known are {', '.join(AOVS)}")
    if names and output.suffix.lower() != ".exr":
        raise CommandError(f"--aov needs an .exr: {output.suffix} has no room for further channels")
    return {name: channels[name] for name in names}


def _write_stats(path: Path, marks: dict[str, float], samples: int) -> None:
    scale = 1 if sys.platform == "darwin" else 1024
    data = {
        "import_s": marks["imported"] - marks["begun"],
        "load_s": marks["loaded"] - marks["imported"],
        "build_s": marks["built"] - marks["loaded"],
        "compile_s": marks["compiled"] - marks["built"],
        "render_s": marks["rendered"] - marks["compiled"],
        "samples": samples,
        "samples_per_s": samples / max(marks["rendered"] - marks["compiled"], 1e-9),
        "peak_memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale,
    }
    text = json.dumps(data, indent=1)
    if str(path) == "-":
        print(text)
    else:
        path.write_text(text + "\n")
