"""Renders the pictures of the examples that the page and README.md show, web/examples/NAME.jpg, denoised.

    python3 farm.py example-pictures                    all of them
    python3 farm.py example-pictures still-life         one of them
    python3 farm.py example-pictures --spp 16 -o /tmp   quickly, elsewhere

A picture shows the view with which the page of its scene opens: the scene's own settings, camera, shape and first frame, WIDTH
pixels wide or MAX_HEIGHT pixels high. Each part of it is rendered until its noise is at most --noise, with --spp samples per
pixel at most, and then denoised (Open Image Denoise).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml
from PIL import Image

__all__ = ["main", "save", "size_of"]

ROOT = Path(__file__).parent.parent
SCENES, PICTURES = ROOT / "scenes", ROOT / "web" / "examples"
WIDTH, MAX_HEIGHT = 1280, 960  # pixels
QUALITY = 88  # of the JPEGs, whose chroma is not subsampled: red checks would lose their edges


def main() -> None:
    """Parses the command line, and renders and writes the pictures."""
    examples = {path.stem: path for path in sorted([*SCENES.glob("*.yaml"), *SCENES.glob("*/*.yaml")])}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="name", help=f"by default all: {', '.join(examples)}")
    parser.add_argument("-o", "--output", type=Path, default=PICTURES, help="a folder; by default web/examples")
    parser.add_argument("--spp", type=int, default=512, help="samples per pixel at most; by default 512")
    parser.add_argument("--noise", type=float, default=0.01, help="relative noise at which a part is finished; by default 0.01")
    parser.add_argument("--threads", type=int, default=0, help="by default one per core")
    options = parser.parse_args()
    unknown = sorted(set(options.names) - set(examples))
    if unknown:
        parser.error(f"no example is named {unknown[0]!r}; the examples are {', '.join(examples)}")
    options.output.mkdir(parents=True, exist_ok=True)
    for name in options.names or examples:
        target = options.output / f"{name}.jpg"
        picture, statistics = rendered(examples[name], options)
        save(picture, target)
        took = f"{statistics['samples'] / 1e6:.1f} M samples in {statistics['render_cpu_s']:.0f} s of processor time"
        print(f"{target.name}: {target.stat().st_size / 1024:.0f} kB, {took}", flush=True)


def size_of(scene: Path) -> tuple[int, int]:
    """Returns the size of a scene's picture in pixels: WIDTH wide or MAX_HEIGHT high, in the shape of the scene's settings."""
    settings = yaml.safe_load(scene.read_text())["settings"]
    scale = min(WIDTH / settings["width"], MAX_HEIGHT / settings["height"])
    return round(scale * settings["width"]), round(scale * settings["height"])


def rendered(scene: Path, options: argparse.Namespace) -> tuple[Image.Image, dict[str, float]]:
    """Returns the denoised picture of a scene, and the statistics of `rayfarm render`. Exits with 1 if that fails."""
    width, height = size_of(scene)
    with tempfile.TemporaryDirectory() as passing:
        output, statistics = Path(passing) / "picture.png", Path(passing) / "statistics.json"
        command = [sys.executable, "-m", "rayfarm", "render", str(scene), "-o", str(output), "--size", f"{width}x{height}"]
        command += ["--spp", str(options.spp), "--noise", str(options.noise), "--denoise", "--stats", str(statistics)]
        command += ["--threads", str(options.threads)] if options.threads else []
        if subprocess.call(command, cwd=ROOT) != 0:
            sys.exit(1)
        picture = Image.open(output.with_stem("picture-denoised")).convert("RGB")
        return picture, json.loads(statistics.read_text())


def save(picture: Image.Image, path: Path) -> None:
    """Writes a picture as a progressive JPEG."""
    picture.save(path, quality=QUALITY, subsampling=0, optimize=True, progressive=True)


if __name__ == "__main__":
    main()
