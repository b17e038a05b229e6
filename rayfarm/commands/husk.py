"""`rayfarm husk`: renders a USD stage by its render settings, with the options of Houdini's husk."""

from __future__ import annotations

import re
from collections.abc import Sequence as Words
from pathlib import Path
from typing import Annotated, Any

import typer

from rayfarm import options
from rayfarm.console import err
from rayfarm.errors import EXIT_FAILED, CommandError
from rayfarm.frame import PictureOrder
from rayfarm.picture import Picture
from rayfarm.reading import open_stage, render_settings
from rayfarm.sequence import Sequence, check_outputs, render_sequence
from renderer import aovs
from renderer.frames import frame_name
from renderer.scene.animation import Moment

__all__ = ["aov_of", "husk", "pattern_of", "register"]

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
LAYERED = ".exr"  # the only format with room for AOVs
MATTE_RANKS = 6
DEEP_TYPE = "deepRaster"  # of products
DEEP_SAMPLES = 32
# AOVs by the source names of render vars, in lower case: Karma's, Hydra's, Arnold's and RenderMan's.
AOVS = {
    "color": ("ci", "c", "color", "rgba", "beauty", "lpebeauty"),
    "depth": ("z", "pz", "depth", "cameradepth", "hitpz", "ray:hitpz"),
    "normal": ("n", "nn", "normal", "hitn", "ray:hitn"),
    "position": ("p", "position", "hitp", "worldposition", "ray:hitp"),
    "albedo": ("albedo", "basecolor", "diffuse_albedo", "bsdf_albedo"),
    "object": ("primid", "objectid", "hitprimid"),
    "material": ("materialid", "shaderid"),
    "samples": ("samplecount", "cpu_samples", "samples"),
    "motion": ("motionvectors", "motionvector", "motion"),
    "cryptomatte": ("cryptomatte", "cryptoobject", "cryptomaterial", "cryptoasset", "crypto_object", "crypto_material"),
    "path:emission": ("directemission", "emission"),
    "path:environment": ("background",),
    "path:diffuse_direct": ("directdiffuse", "diffuse_direct"),
    "path:diffuse_indirect": ("indirectdiffuse", "diffuse_indirect"),
    "path:glossy_direct": ("directglossyreflection", "specular_direct", "directspecular"),
    "path:glossy_indirect": ("indirectglossyreflection", "specular_indirect", "indirectspecular"),
    "path:transmission_direct": ("transmission_direct",),
    "path:transmission_indirect": ("transmission_indirect",),
    "path:volume_direct": ("directvolume", "volume_direct"),
    "path:volume_indirect": ("indirectvolume", "volume_indirect"),
}
# AOVs by light path expressions: the first vertex, for indirect light any further ones, and what emits.
LOBES = {"diffuse": "C<RD>", "glossy": "C<R[GS]>", "transmission": "C<T[GS]>", "volume": "C<V.>"}
EXPRESSIONS = {
    f"{start}{more}{end}": f"path:{lobe}_{kind}"
    for lobe, start in LOBES.items()
    for kind, more in (("direct", ""), ("indirect", ".+"))
    for end in ("L", "<L.>", "[LO]", "[<L.>O]")
}
BEAUTY_PATHS = ("C.*", "C.+", "C.*[LO]", "C.*<L.>", "C.*[<L.>O]")  # light path expressions of the whole picture
_NUMBER = re.compile(r"\$F(\d*)|<F(\d*)>|%0?(\d*)d")


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("husk", context_settings={"ignore_unknown_options": True, "allow_extra_args": True})(husk)


def husk(
    context: typer.Context,
    stage: Annotated[Path, typer.Argument(help=f"A USD file: {' '.join(SUFFIXES)}.")],
    frame: Annotated[
        int | None, typer.Option("--frame", "-f", metavar="N", help="The first frame, a time code; by default the stage's first.")
    ] = None,
    frame_count: Annotated[int, typer.Option("--frame-count", "-n", min=1, max=100_000, metavar="M", help="How many.")] = 1,
    frame_inc: Annotated[int, typer.Option("--frame-inc", "-i", min=1, max=100_000, metavar="N", help="Every Nth frame.")] = 1,
    output: Annotated[
        str | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="The picture, with ####, $F4, <F4> or %04d for the frame; by default the render product's name.",
        ),
    ] = None,
    settings: Annotated[
        str | None, typer.Option("--settings", "-s", metavar="PRIM", help="The render settings; by default the stage's own.")
    ] = None,
    camera: Annotated[
        str | None, typer.Option("--camera", "-c", metavar="PRIM", help="The camera; by default the settings'.")
    ] = None,
    res: Annotated[
        tuple[int, int] | None, typer.Option("--res", "-r", metavar="W H", help="Pixels; by default the settings'.")
    ] = None,
    res_scale: Annotated[
        float, typer.Option("--res-scale", min=0.1, max=1000, metavar="PERCENT", help="Scales the size.")
    ] = 100.0,
    pixel_samples: Annotated[
        int | None, typer.Option("--pixel-samples", "-p", min=1, metavar="N", help="Samples per pixel.")
    ] = None,
    make_output_path: Annotated[bool, typer.Option("--make-output-path", help="Make the folders of the output.")] = False,
    overwrite: options.Overwrite = False,
    root: options.Root = None,
    threads: Annotated[int | None, typer.Option("--threads", "-j", min=1, help="Threads; by default one per core.")] = None,
) -> None:
    """Render a USD stage by its render settings, product and vars (UsdRender), with the options of Houdini's husk.

    Frames are time codes of the stage. An .exr gets the AOVs of the product's vars. Options of husk that have no counterpart
    are refused.

    [bold]Examples[/bold]

      rayfarm husk shot.usd --frame 1001 --frame-count 24 -o out.####.exr
      rayfarm husk shot.usd -f 1001 -n 24 --res-scale 50 --make-output-path
    """
    unknown = [word for word in (str(stage), *context.args) if word.startswith("-")] or context.args
    if unknown:
        raise CommandError(f"{unknown[0]} is not an option of husk that Rayfarm has; `rayfarm husk --help` lists those")
    if stage.suffix.lower() not in SUFFIXES:
        raise CommandError(f"{stage.name} is not a USD file: {', '.join(SUFFIXES)}. Others are rendered by `rayfarm render`")
    found = render_settings(stage, frame, frame_count, frame_inc, root)
    chosen = _chosen(found, settings, stage)
    product = _product(chosen)
    _say_unused(chosen, product)
    names = [output or name for name in (product["names"] if product else [""] * frame_count)]
    if not all(names):
        raise CommandError(f"{stage.name} has no render product with a name; name the picture with -o")
    files = _files([pattern_of(name) for name in names], found["codes"], base=Path() if output else stage.parent)
    if make_output_path:
        for folder in {path.parent for path in files}:
            folder.mkdir(parents=True, exist_ok=True)
    size = res or (product or {}).get("resolution") or chosen.get("resolution")
    planes = _planes(product["vars"] if product else [], files[0].suffix.lower())
    view = camera or (product or {}).get("camera") or chosen.get("camera")
    given: dict[str, Any] = {"spp": pixel_samples, "cryptomatte": MATTE_RANKS if "cryptomatte" in planes else None}
    if any(map(aovs.is_path, planes)):
        given["light_paths"] = "on"
    if any(each["type"] == DEEP_TYPE for each in chosen.get("products", ())):
        given["deep"] = DEEP_SAMPLES
    moments = dict(zip(_moments(found, stage), files, strict=True))
    name = None if view is None else view.rsplit("/", 1)[-1]
    environment = Picture().environment()
    with open_stage(stage, environment, camera=name, threads=threads, root=root, placement=Picture().placement()) as opened:
        first = next(iter(moments))
        summary = opened.scene_at(Moment(first))[1]
        _check_camera(summary, name, view, stage)
        if size is None and res_scale != 100:
            size = tuple(summary["defaults"].get(side, default) for side, default in (("width", 960), ("height", 540)))
        if size is not None:
            given["size"] = "x".join(str(max(1, round(side * res_scale / 100))) for side in size)
        picture = Picture({**given, "camera": name})
        shot = Sequence(stage, list(moments), files[0], Moment(first), overwrite, moments)
        check_outputs(shot)
        result = render_sequence(shot, opened, PictureOrder(picture, planes, False, 0.0, "neutral", None, 0, None, threads))
    if result["failed"]:
        raise typer.Exit(EXIT_FAILED)


def pattern_of(name: str) -> str:
    """Returns a file name of husk with #### in place of $F4, <F4> and %04d, which stand for the frame's number."""
    return _NUMBER.sub(lambda match: "#" * int(next((width for width in match.groups() if width), "1")), name)


def aov_of(source: str, kind: str) -> str | None:
    """Returns the AOV that a render var names; None if there is none. kind: its sourceType."""
    if kind == "lpe" or source.startswith("lpe:"):
        expression = source.removeprefix("lpe:").replace(" ", "")
        return "color" if expression in BEAUTY_PATHS else EXPRESSIONS.get(expression)
    name = source.lower()
    return next((aov for aov, sources in AOVS.items() if name in sources), None)


def _chosen(found: dict[str, Any], settings: str | None, stage: Path) -> dict[str, Any]:
    """Returns the render settings to use: the named ones, else the stage's own, else its first; empty if it has none."""
    known: dict[str, dict[str, Any]] = found["settings"]
    if settings is not None and settings not in known:
        listed = f"its render settings are {', '.join(known)}" if known else "it has no render settings"
        raise CommandError(f"--settings is {settings}; {stage.name} has none of this path: {listed}")
    path = settings or (found["default"] if found["default"] in known else next(iter(known), None))
    return known[path] if path is not None else {}


def _product(chosen: dict[str, Any]) -> dict[str, Any] | None:
    """Returns the product to render, the first raster, or else the first deep one; None if there is none.

    A deep picture is written beside it.
    """
    products = chosen.get("products", ())
    found = next((each for kind in ("raster", DEEP_TYPE) for each in products if each["type"] == kind), None)
    deep = next((each for each in products if each["type"] == DEEP_TYPE), None)
    if deep is not None:
        _note(f"The deep render product {deep['path']} is written beside the picture, as NAME.deep.exr")
    for each in products:
        if each is not found and each is not deep:
            _note(f"The render product {each['path']} is left out: the first raster product is rendered")
    return found


def _say_unused(chosen: dict[str, Any], product: dict[str, Any] | None) -> None:
    for name in dict.fromkeys([*chosen.get("unused", ()), *(product or {}).get("unused", ())]):
        _note(f"The render settings' {name} is ignored")


def _files(patterns: list[str], codes: list[int], base: Path) -> list[Path]:
    """Returns the file of each frame. base: the folder of relative names."""
    if min(codes) < 0:
        raise CommandError(f"--frame is {min(codes)}; files are numbered from 0")
    files = [base / Path(name).parent / frame_name(Path(name).name, code) for name, code in zip(patterns, codes, strict=True)]
    if len(set(files)) < len(files):
        path = Path(patterns[0])
        raise CommandError(
            f"{patterns[0]} is one file for {len(files)} frames. Write #### for their numbers: -o {path.stem}.####{path.suffix}"
        )
    return files


def _planes(variables: Words[dict[str, Any]], suffix: str) -> list[str]:
    """Returns the AOVs of a product's vars, without colour, which every picture has."""
    planes: dict[str, None] = {}
    for each in variables:
        aov = aov_of(each["source"], each["kind"])
        if aov is None:
            _note(f"The render var {each['path']} ({each['source'] or 'without a source'}) is left out: Rayfarm has no such AOV")
        elif aov != "color":
            planes[aov] = None
    if planes and suffix != LAYERED:
        _note(f"The render vars {', '.join(planes)} are left out: {suffix} has no room for further channels")
        return []
    return list(planes)


def _moments(found: dict[str, Any], stage: Path) -> list[float]:
    """Returns the frames to render, counted from the stage's start; one for each time code."""
    start = found["start"]
    if start is None:  # nothing moves: every frame is the same picture
        return [float(index) for index in range(len(found["codes"]))]
    moments = [(code - start) * found["fps"] / found["codes_per_second"] for code in found["codes"]]
    if min(moments) < 0:
        raise CommandError(f"--frame is {min(found['codes'])}; {stage.name} begins at {start:g}")
    return moments


def _check_camera(summary: dict[str, Any], name: str | None, path: str | None, stage: Path) -> None:
    same = sum(each["name"] == name for each in summary["cameras"])
    if name is not None and same > 1:
        raise CommandError(f"{stage.name} has {same} cameras of the name {name}; rename the one at {path}")


def _note(text: str) -> None:
    err.print(f"note: {text}", markup=False, soft_wrap=True)
