"""`rayfarm compare`: compares Rayfarm's picture with that of Mitsuba or pbrt."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from rayfarm.console import bar, err, out
from rayfarm.errors import EXIT_FAILED, CommandError
from rayfarm.output_files import check_writable, write

__all__ = ["register"]

BLOCK = 8
MAX_SHOWN_DIFFERENCE = 0.5  # relative difference shown in full colour
MISSING_MITSUBA = 'Mitsuba is not installed in this Python: pip install "mitsuba>=3.5"'
MISSING_PBRT = (
    "There is no program pbrt on the PATH to compare with. Build pbrt-v4 (github.com/mmp/pbrt-v4) and put it there, or render "
    "the scene by Rayfarm alone: rayfarm render {scene} -o picture.exr"
)


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("compare")(compare)


def compare(
    scene: Annotated[Path, typer.Argument(help="A Mitsuba (.xml) or pbrt-v4 (.pbrt) scene, with the files it names beside it.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="A .png: Rayfarm's picture, the other's, and where they differ.", metavar="FILE.png"),
    ] = None,
    spp: Annotated[int, typer.Option(min=1, help="Samples per pixel, for both.")] = 256,
    most: Annotated[
        float | None,
        typer.Option(
            min=0.0, metavar="FRACTION", help="Exit with 1 if the means differ by more than this, for scripts: 0.03 is 3 %."
        ),
    ] = None,
    exposure: Annotated[float, typer.Option(help="Exposure of the picture that is written, in stops.")] = 0.0,
) -> None:
    """Render a Mitsuba or pbrt scene with Rayfarm and with its own renderer, and say how closely they agree.

    Differences have three sources: noise (a higher --spp reduces it), what Rayfarm does not read (listed as notes), and models
    that differ on purpose: here rough metals return the energy that a single bounce loses, and smooth normals do not darken
    at the shadow's edge.

    [bold]Example[/bold]

      rayfarm compare cbox.xml --spp 512 -o cbox-compared.png
    """
    suffix = scene.suffix.lower()
    if suffix not in (".xml", ".pbrt"):
        raise CommandError(f"{scene.name} is not a Mitsuba or pbrt scene; those are .xml and .pbrt files")
    peer_name = "pbrt" if suffix == ".pbrt" else "Mitsuba"
    if output is not None:
        if output.suffix.lower() != ".png":
            raise CommandError(f"{output.name}: the output is a .png file; use that suffix")
        check_writable(output)
    peer = _pbrt(scene) if peer_name == "pbrt" else _mitsuba()
    import numpy as np

    from rayfarm.library.render import render
    from rayfarm.reading import known_differences

    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        ours = render(scene, spp=spp, aovs="color")["color"].astype(np.float64)
    for note in notes:
        err.print(f"note: {note.message}", markup=False, soft_wrap=True)
    with bar() as progress:
        progress.add_task(f"{peer_name} is rendering", total=None)
        theirs = _pbrt_picture(peer, scene, spp) if peer_name == "pbrt" else _mitsuba_picture(peer, scene, spp)
    if theirs.shape != ours.shape:
        sizes = [f"{each.shape[1]}x{each.shape[0]}" for each in (theirs, ours)]
        raise CommandError(f"{peer_name}'s picture is {sizes[0]}, and ours {sizes[1]}")
    ratio = ours.mean() / max(theirs.mean(), 1e-12)
    out.print(f"mean        {ours.mean():.5g} of Rayfarm, {theirs.mean():.5g} of {peer_name}: {ratio - 1:+.2%}")
    for name, a, b in zip(("red", "green", "blue"), ours.mean((0, 1)), theirs.mean((0, 1)), strict=True):
        out.print(f"  {name:<9} {a:.5g}, {b:.5g}: {a / max(b, 1e-12) - 1:+.2%}")
    blocks = _block_differences(ours, theirs)
    out.print(
        f"{BLOCK}x{BLOCK} blocks  relative difference: median {np.median(blocks):.2%}, "
        f"95 % below {np.percentile(blocks, 95):.2%}, the most {blocks.max():.2%}",
        soft_wrap=True,
    )
    relative = ((ours - theirs) ** 2 / (theirs**2 + 1e-2)).mean()
    out.print(f"relMSE      {relative:.4g}; of noise alone it falls as samples grow")
    for reason in known_differences(scene, peer_name):
        out.print(f"known: {reason}.", markup=False, soft_wrap=True)
    if output is not None:
        write(output, _side_by_side(ours, theirs, exposure))
        err.print(f"{output} written", markup=False, soft_wrap=True)
    if most is not None and abs(ratio - 1) > most:
        raise typer.Exit(EXIT_FAILED)


def _mitsuba() -> Any:
    try:
        import mitsuba
    except ImportError:
        raise CommandError(MISSING_MITSUBA) from None
    mitsuba.set_variant("scalar_rgb")  # the variant that works without LLVM
    return mitsuba


def _mitsuba_picture(mitsuba: Any, scene: Path, spp: int) -> Any:
    """Renders the scene with Mitsuba. Returns the picture, (h, w, 3) float64."""
    import numpy as np

    try:
        return np.array(mitsuba.render(mitsuba.load_file(str(scene)), spp=spp), np.float64)[..., :3]
    except RuntimeError as error:
        raise CommandError(f"Mitsuba cannot render {scene.name}: {' '.join(str(error).split())[:300]}") from None


def _pbrt(scene: Path) -> str:
    found = shutil.which("pbrt")
    if found is None:
        raise CommandError(MISSING_PBRT.format(scene=scene.name))
    return found


def _pbrt_picture(program: str, scene: Path, spp: int) -> Any:
    """Renders the scene with pbrt. Returns the picture, (h, w, 3) float64."""
    import numpy as np

    from rayfarm.reading_files import read_picture

    with tempfile.TemporaryDirectory(prefix="rayfarm-pbrt-") as folder:
        picture = Path(folder) / "picture.exr"
        ended = subprocess.run(
            [program, "--quiet", "--spp", str(spp), "--outfile", str(picture), scene.name],
            cwd=scene.parent,
            capture_output=True,
            text=True,
            check=False,
        )
        if ended.returncode != 0 or not picture.is_file():
            said = " ".join((ended.stderr or ended.stdout).split())[-300:]
            raise CommandError(f"pbrt cannot render {scene.name}: {said or f'it ended with {ended.returncode}'}")
        return np.asarray(read_picture(picture.read_bytes(), picture.name), np.float64)[..., :3]


def _block_differences(ours: Any, theirs: Any) -> Any:
    """Returns the relative difference between the means of the two pictures in each block of pixels."""
    import numpy as np

    height, width = (max(side // BLOCK, 1) for side in ours.shape[:2])
    means = [
        np.stack([part.mean((0, 1)) for row in np.array_split(each, height) for part in np.array_split(row, width, axis=1)])
        for each in (ours, theirs)
    ]
    floor = 0.02 * max(float(theirs.mean()), 1e-12)  # limits the relative difference of nearly black blocks
    return np.abs(means[0] - means[1]).mean(-1) / (means[1].mean(-1) + floor)


def _side_by_side(ours: Any, theirs: Any, exposure: float) -> bytes:
    """Returns a PNG of both pictures and their relative difference: blue where `ours` is darker, red where it is brighter."""
    import numpy as np

    from renderer.image import encode, tonemap

    away = (ours - theirs).mean(-1) / (theirs.mean(-1) + 0.02 * max(float(theirs.mean()), 1e-12)) / MAX_SHOWN_DIFFERENCE
    more, less = np.clip(away, 0, 1), np.clip(-away, 0, 1)
    shade = np.stack([1 - less, 1 - np.maximum(more, less), 1 - more], axis=-1)
    shown = [tonemap.apply(each.astype(np.float32), exposure) for each in (ours, theirs)]
    return encode.encode_shown(np.concatenate([*shown, (shade * 255).astype(np.uint8)], axis=1), "png")
