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
from rayfarm.picture import DEFAULT_SPP, Picture, takes_picture
from rayfarm.scene_files import opened
from renderer import aovs
from renderer.denoise import is_available
from renderer.settings import RenderSettings, Tile

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from renderer.film import Sums
    from renderer.render import RenderStats
    from renderer.scene.compiled import CompiledScene

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("render")(render)


@takes_picture
def render(
    scene: Annotated[Path, typer.Argument(help="A scene file (.yaml .glb .gltf .obj .dae .ply .stl .off), a folder, or a .zip.")],
    output: options.Output,
    picture: Picture = Picture(),
    aov: options.Aov = None,
    denoise: options.Denoise = False,
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
    planes = _aovs(aov, output)
    rectangle = options.parse_tile(tile) if tile else None
    environment, _ = picture.environment()
    if not output.parent.is_dir():
        raise CommandError(f"There is no folder {output.parent} to write {output.name} to. Make it first.")

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
    compiled, summary = _load(scene, environment, clock)
    for warning in summary["warnings"]:
        err.print(f"note: {warning}", markup=False, soft_wrap=True)

    defaults = summary["defaults"]
    settings = picture.settings(summary["cameras"], defaults)
    width, height = settings.width, settings.height
    count = picture.spp or defaults.get("spp", DEFAULT_SPP)
    done = RenderStats()
    if tile is None and first == 0:
        sums = _frame(compiled, settings, count, threads, picture.noise, picture.time_limit, done)
    else:
        sums = _part(compiled, settings, rectangle or Tile(0, 0, width, height), first, count, done)
    clock.mark("render_s")
    color = mean(sums, settings.film_exponent)
    channels = aovs.layers({name: aovs.values(sums, settings.film_exponent, name) for name in planes})
    encode.write(output, color, exposure=exposure, curve=tonemap, channels=channels)
    if denoise:
        clean = _denoised(sums, settings.film_exponent, threads)
        encode.write(options.denoised_name(output), clean, exposure=exposure, curve=tonemap, channels=channels)
        clock.mark("denoise_s")

    seconds = max(clock.seconds["render_s"], 1e-9)
    taken = done.samples / (width * height)
    speed = f"{taken:.4g} spp, {seconds:.1f} s, {done.samples / seconds / 1e6:.2f} M samples/s"
    err.print(f"{output}: {width}x{height}, {speed}", markup=False, soft_wrap=True)
    if done.bad_count:
        x, y, sample = done.bad[0]
        which = f"the first is sample {sample} of pixel {x},{y}"
        err.print(f"note: {done.bad_count} samples were not finite and are left out; {which}.", markup=False, soft_wrap=True)
    if stats is not None:
        _write_stats(stats, clock, done)


def _denoised(sums: Sums, film_exponent: int, threads: int | None) -> npt.NDArray[np.float32]:
    from renderer.denoise import denoise
    from renderer.film import ALBEDO, COLOR, NORMAL, mean

    color, albedo, normal = (mean(sums, film_exponent, channel) for channel in (COLOR, ALBEDO, NORMAL))
    return denoise(color, albedo, normal, threads)


class Clock:
    """Seconds of each step, from one mark to the next: wall time, and processor time of all threads."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}
        self._last = time.perf_counter(), time.process_time()

    def mark(self, step: str) -> None:
        """A step ends here."""
        now = time.perf_counter(), time.process_time()
        self.seconds[step], self.cpu_seconds[step] = now[0] - self._last[0], now[1] - self._last[1]
        self._last = now


def _load(scene: Path, environment: Path | None, clock: Clock) -> tuple[CompiledScene, dict[str, Any]]:
    """The compiled scene and its summary. Read first: a wrong file is told before half a minute of compiling."""
    from renderer.render import warm_up
    from renderer.scene.compile import compile_scene, summarise
    from renderer.scene.load import read

    with bar() as progress:
        step = progress.add_task("reading", total=None)
        with opened(scene, environment) as (folder, main, inside):
            description = read(folder, main, inside)
        clock.mark("load_s")
        progress.update(step, description="loading the kernels (the first time compiles them: half a minute)")
        warm_up()
        clock.mark("compile_s")
        progress.update(step, description="building")
        compiled = compile_scene(description)
        summary = summarise(description, compiled)
        clock.mark("build_s")
    return compiled, summary


def _frame(
    compiled: CompiledScene,
    settings: RenderSettings,
    spp: int,
    threads: int | None,
    noise: float | None,
    time_limit: float | None,
    done: RenderStats,
) -> Sums:
    """The whole frame's sums, with a progress bar."""
    from renderer.film import noise as noise_of
    from renderer.render import render_frame

    ticker = Ticker()
    with bar() as progress:
        task = progress.add_task("rendering", total=None)

        def show(part: int, whole: int) -> None:
            progress.update(task, completed=part, total=whole)
            ticker.tick(f"rendering: {100 * part / max(whole, 1):.0f} %")

        def quiet_enough(sums: Sums) -> bool:
            return noise is not None and noise_of(sums, settings.film_exponent) <= noise

        return render_frame(compiled, settings, spp, threads, progress=show, stats=done, stop=quiet_enough, time_limit=time_limit)


def _part(compiled: CompiledScene, settings: RenderSettings, tile: Tile, first: int, count: int, done: RenderStats) -> Sums:
    """A frame's sums with one batch in it: what a worker of a farm renders."""
    import numpy as np

    from renderer.film import CHANNELS
    from renderer.render import render_batch

    x, y, w, h = tile
    if min(x, y) < 0 or min(w, h) < 1 or x + w > settings.width or y + h > settings.height:
        raise CommandError(f"--tile reaches out of the picture of {settings.width}x{settings.height} pixels")
    batch = render_batch(compiled, settings, tile, first, count)
    sums = np.zeros((CHANNELS, settings.height, settings.width), np.int64)
    sums[:, y : y + h, x : x + w] = batch.sums
    done.samples, done.bad, done.bad_count = w * h * count, batch.bad, batch.bad_count
    return sums


def _aovs(text: str | None, output: Path) -> list[str]:
    names = aovs.known(name.strip() for name in text.split(",")) if text else []
    if names and output.suffix.lower() != ".exr":
        raise CommandError(f"--aov needs an .exr: {output.suffix} has no room for further channels")
    return names


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
