"""Renders the example shot on the farm that runs here, and makes the film and filmstrip that docs/ show.

    python3 farm.py up              in one terminal
    python3 farm.py film            in another: about an hour on two cores

    python3 farm.py film --samples 4 --size 320x180 -o /tmp        a quick version, elsewhere

The frames are stored as PNGs, with denoised copies, in the folder given by --frames: the same command continues an interrupted
run.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from caterpillar_moves import FPS, FRAMES
from PIL import Image, ImageDraw, ImageFont

from renderer.frames import frame_name
from service.watching.movie import write_movie

__all__ = ["filmstrip", "main", "write_webp"]

ROOT = Path(__file__).parent.parent
NAME = "caterpillar"
SHOWN = (6, 22, 36, 52, 64, 84)  # frames of the filmstrip
EDGE, HOLE = 22, 10  # pixels of the filmstrip's rim and its holes


def main() -> None:
    """Parses the command line, renders the shot, and writes the film and filmstrip."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "pictures", help="docs/pictures unless told")
    parser.add_argument("--frames", type=Path, help="a folder for the frames; a passing one unless told")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--server", help="another farm than the one that runs here")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as passing:
        folder = options.frames or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        scene = ROOT / "scenes" / NAME / f"{NAME}.yaml"
        command = [sys.executable, "-m", "rayfarm", "submit", str(scene), "--frames", f"0-{FRAMES - 1}", "--size", options.size]
        command += ["--spp", str(options.samples), "--denoise", "--order", "breadth-first", "-o", str(folder / "####.png")]
        command += ["--server", options.server] if options.server else []
        if subprocess.call(command, cwd=ROOT) != 0:
            sys.exit(1)
        frames = [Image.open(folder / frame_name("####-denoised.png", n)).convert("RGB") for n in range(FRAMES)]
    options.output.mkdir(parents=True, exist_ok=True)
    write_movie(options.output / f"{NAME}.mp4", map(np.asarray, frames), FPS)
    write_webp(options.output / f"{NAME}.webp", frames)
    strip = filmstrip([frames[n] for n in SHOWN], list(SHOWN))
    strip.save(options.output / f"{NAME}-filmstrip.jpg", quality=88, optimize=True)
    written = [f"{NAME}.mp4", f"{NAME}.webp", f"{NAME}-filmstrip.jpg"]
    for name in written:
        print(f"{name}: {(options.output / name).stat().st_size / 1024:.0f} kB", flush=True)


def write_webp(path: Path, frames: list[Image.Image], quality: int = 72) -> None:
    """Writes a small, looping animated WebP, for pages that show no video."""
    # Integer milliseconds that add up to the film's duration.
    ends = [round(1000 * (i + 1) / FPS) for i in range(len(frames))]
    durations = [end - begin for begin, end in zip([0, *ends], ends, strict=False)]
    # Key frames only (kmax): difference frames show block seams.
    packed = {"quality": quality, "method": 6, "kmin": 0, "kmax": 1}
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, **packed)


def filmstrip(frames: list[Image.Image], numbers: list[int], width: int = 300) -> Image.Image:
    """Returns frames side by side between two perforated rims, each with its number."""
    height = round(width * frames[0].height / frames[0].width)
    gap = 6
    strip = Image.new("RGB", (gap + len(frames) * (width + gap), height + 2 * EDGE), (16, 16, 18))
    draw = ImageDraw.Draw(strip)
    for x in range(HOLE, strip.width, 2 * HOLE):
        for y in ((EDGE - HOLE) // 2, strip.height - (EDGE + HOLE) // 2):
            draw.rounded_rectangle((x - HOLE // 2, y, x + 2, y + HOLE), 2, (228, 228, 224))
    font = ImageFont.load_default(13)
    for i, (frame, number) in enumerate(zip(frames, numbers, strict=True)):
        at = (gap + i * (width + gap), EDGE)
        strip.paste(frame.resize((width, height), Image.Resampling.LANCZOS), at)
        draw.text((at[0] + 8, at[1] + height - 8), str(number), "white", font, "ls", stroke_width=1, stroke_fill="black")
    return strip


if __name__ == "__main__":
    main()
