"""`rayfarm bench`: measures how much each part of the renderer speeds up rendering on this machine, and prints tables."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from rayfarm import machine
from rayfarm.console import bar, err, out
from rayfarm.errors import CommandError
from rayfarm.options import Env
from rayfarm.picture import Picture
from rayfarm.reading import open_stage
from service.locations import shipped_folder

if TYPE_CHECKING:
    from renderer.film import Sums
    from renderer.scene.compiled import CompiledScene
    from renderer.settings import RenderSettings

__all__ = ["register"]

SCENE = shipped_folder("scenes") / "still-life.yaml"
SIZE = "64x36"
MIN_RUN_S = 0.5  # seconds; shorter runs are repeated with more samples
MAX_SAMPLES = 4096
PROBE_FACTOR = 8  # factor by which the picture is reduced to estimate the time

Scene = Annotated[Path | None, typer.Option(metavar="SCENE", help="The scene to measure; by default scenes/still-life.yaml.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]


def register(app: typer.Typer) -> None:
    """Adds the command and its subcommands to the program."""
    tables = typer.Typer(no_args_is_help=True, help="Measure this machine: what makes rendering fast, as tables.")
    tables.command("bvh")(bvh)
    app.add_typer(tables, name="bench")


@dataclass
class Row:
    """Settings, time and result of one run of the benchmark. All runs render the same picture.

    bvh: whether the BVH is used. digest: of the picture.
    """

    bvh: bool
    threads: int
    seconds: float
    digest: str


def bvh(
    scene: Scene = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Pixels.")] = SIZE,
    spp: Annotated[int, typer.Option(min=1, help="Samples per pixel.")] = 1,
    patience: Annotated[float, typer.Option(metavar="S", help="Do not run if the estimated time exceeds this.")] = 600.0,
    as_json: Json = False,
) -> None:
    """Render one picture four times: with and without the BVH, with one thread and with all.

    Without it every ray is tested against every triangle and sphere. The pictures are the same to the bit; only the time differs.

    [bold]Examples[/bold]

      rayfarm bench bvh
      rayfarm bench bvh --scene truck.glb --size 64x36
    """
    from renderer.film import digest
    from renderer.render import variant_for, warm_up
    from renderer.scene.animation import Moment

    path = scene or SCENE
    with open_stage(path, Env()) as stage:
        tree, summary = stage.scene_at(Moment())
    with open_stage(path, Env(), brute=True) as stage:
        brute, _ = stage.scene_at(Moment())
    settings = Picture({"size": size}).settings(summary["cameras"], summary["defaults"])
    warm_up(settings, variant_for(settings, tree), prepares=False)
    expected = _expected_s(brute, settings, spp)
    cores = machine.cores()
    if expected * (1 + 1 / cores) > patience:
        raise CommandError(
            f"Without the BVH this takes about {expected:.0f} s with one thread. "
            "Take a smaller --size or fewer --spp, or raise --patience."
        )
    rows = []
    with bar() as progress:
        task = progress.add_task("measuring", total=4)
        for compiled, has_tree in ((brute, False), (tree, True)):
            for threads in (1, cores):
                seconds, sums = _render_timed(compiled, settings, spp, threads)
                same = digest(sums)
                if seconds < MIN_RUN_S:
                    more = min(int(spp * MIN_RUN_S / seconds) + 1, MAX_SAMPLES)
                    seconds = _render_timed(compiled, settings, more, threads)[0] * spp / more
                rows.append(Row(has_tree, threads, seconds, same))
                progress.advance(task)
    if as_json:
        print(json.dumps({"scene": path.name, "counts": summary["counts"], "rows": [vars(row) for row in rows]}, indent=1))
        return
    _print_results(path, summary["counts"], settings, spp, rows)


def _render_timed(compiled: CompiledScene, settings: RenderSettings, spp: int, threads: int) -> tuple[float, Sums]:
    from renderer.render import render_frame

    begun = time.perf_counter()
    sums = render_frame(compiled, settings, spp, threads)
    return time.perf_counter() - begun, sums


def _expected_s(compiled: CompiledScene, settings: RenderSettings, spp: int) -> float:
    """Returns the estimated time, in seconds, to render the whole picture with one thread.

    The estimate is extrapolated from a smaller picture, whose rendering is timed.
    """
    small = replace(settings, width=max(settings.width // PROBE_FACTOR, 1), height=max(settings.height // PROBE_FACTOR, 1))
    return _render_timed(compiled, small, 1, 1)[0] * settings.width * settings.height * spp / (small.width * small.height)


def _print_results(path: Path, counts: dict[str, int], settings: RenderSettings, spp: int, rows: list[Row]) -> None:
    what = f"{counts['triangles']:,} triangles, {counts['spheres']:,} spheres"
    out.print(f"{path.name}: {what}, {settings.width}x{settings.height}, {spp} spp", markup=False)
    table = Table(box=None, pad_edge=False)
    for title in ("BVH", "THREADS", "SECONDS", "SPEED"):
        table.add_column(title, justify="left" if title == "BVH" else "right")
    for row in rows:
        speed = rows[0].seconds / max(row.seconds, 1e-9)
        table.add_row("on" if row.bvh else "off", str(row.threads), f"{row.seconds:.4g}", f"{speed:.1f} x")
    out.print(table)
    if len({row.digest for row in rows}) == 1:
        out.print("All four pictures are the same to the bit.")
    else:
        err.print("note: the pictures differ; please report that with the scene.")
