"""`rayfarm info`: shows the contents of a scene."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from rayfarm import options
from rayfarm.console import bar, out
from rayfarm.reading import describe
from rayfarm.strict import refuse_warnings

__all__ = ["NOTES", "register"]

# Codes of messages that are notes, as on the page (web/js/base/codes.js): guesses where a file leaves something open, and the
# studio light of a scene without one. All others are warnings.
NOTES = frozenset(
    {
        "collada-camera-aspect-guessed",
        "image-colour-profile-ignored",
        "mesh-decimal-commas",
        "mtl-bump-read-as-normal",
        "mtl-decimal-commas",
        "names-encoding-guessed",
        "names-encoding-likely",
        "obj-image-guessed",
        "obj-library-guessed",
        "points-shown-as-spheres",
        "scene-files-several",
        "scene-without-light",
        "up-axis-guessed",
        "usd-metadata-not-double",
    }
)


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("info")(info)


def info(
    scene: Annotated[Path, typer.Argument(help="A scene file, a folder, or a .zip.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")] = False,
    strict: options.Strict = False,
    root: options.Root = None,
) -> None:
    """Show a scene's cameras, counts, bounds and warnings.

    [bold]Example[/bold]

      rayfarm info truck.glb
    """
    begun = time.perf_counter()
    with bar() as progress:
        task = progress.add_task("reading", total=None)
        summary = describe(scene, lambda step: progress.update(task, description=step), root)
    summary["seconds"] = round(time.perf_counter() - begun, 3)
    if as_json:
        print(json.dumps(summary, indent=1))
    else:
        _print_summary(summary)
    refuse_warnings(scene.name, summary["warnings"], strict)


def _print_summary(summary: dict[str, Any]) -> None:
    def line(title: str, text: str) -> None:
        out.print(f"{title:<11} {text}", markup=False, soft_wrap=True)

    line("Scene", f"{summary['name']} ({summary['main']}, read and built in {summary['seconds']:.2f} s)")
    line("Holds", ", ".join(_count_with_noun(count, noun) for noun, count in summary["counts"].items() if count))
    lower, upper = summary["bounds"]
    line("Bounds", f"{_vector(lower)} to {_vector(upper)}")
    for number, camera in enumerate(summary["cameras"]):
        view = camera["view"]
        text = f"{number}: {camera['name']}, eye {_vector(view['eye'])}, target {_vector(view['target'])}, fov {view['fov']:.4g}"
        line("Cameras" if number == 0 else "", text)
    for number, name in enumerate(summary["variants"]):
        line("Variants" if number == 0 else "", f"{number}: {name}")
    for number, clip in enumerate(summary["clips"]):
        line("Clips" if number == 0 else "", f"{number}: {clip['name']}, {_span(clip['start'], clip['end'], summary['fps'])}")
    if summary["defaults"]:
        line("Asks for", ", ".join(f"{key} {value}" for key, value in summary["defaults"].items()))
    for warning in summary["warnings"]:
        line("Note" if getattr(warning, "code", "") in NOTES else "Warning", warning)


def _count_with_noun(count: int, plural: str) -> str:
    """Returns a count with its noun: `1 mesh`, `2 meshes`."""
    singular = {"meshes": "mesh", "vertices": "vertex"}.get(plural, plural.removesuffix("s"))
    return f"{count:,} {(singular if count == 1 else plural).replace('_', ' ')}"


def _span(start: float, end: float, fps: float) -> str:
    return f"{start:.4g} to {end:.4g} s (frames 0 to {max(math.ceil(end * fps - 1e-6), 0)} at {fps:g} a second)"


def _vector(values: list[float]) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in values) + ")"
