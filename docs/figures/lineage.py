"""Renders the pictures and measures the numbers of docs/lineage.md.

    python docs/figures/lineage.py [name ...]        (after: pip install -e '.[docs]')

Without names, renders all: about ten minutes on two cores. Pictures and plots go to docs/pictures/lineage/; numbers are printed
as the tables of that page. The farm's frames are identical to the bit.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot
from PIL import Image, ImageDraw, ImageFont

from renderer.arrays.scene import CompiledScene
from renderer.film import mean
from renderer.image.tonemap import apply
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import LIGHT_CHOICES, RenderSettings

HERE = Path(__file__).parent
SCENES = HERE.parents[1] / "scenes"
OUT = HERE.parent / "pictures" / "lineage"

Picture = np.ndarray


class Example:
    """An example scene from scenes/, with the settings of its file; renders pictures of it."""

    def __init__(self, name: str, width: int) -> None:
        description = read(SCENES, f"{name}.yaml")
        self.scene: CompiledScene = compile_scene(description)
        own = dict(description.defaults)
        self.spp = int(own.pop("spp"))
        height = round(width * own.pop("height") / own.pop("width"))
        own = {key: tuple(value) if isinstance(value, list) else value for key, value in own.items()}
        self.settings = RenderSettings(width, height, description.cameras[0].view, **own)

    def sums(self, spp: int | None = None, **changed: Any) -> Picture:
        """Returns the sums of samples that a frame's film contains.

        spp: samples per pixel; None: the example's own number. changed: render settings that replace the example's.
        """
        return render_frame(self.scene, replace(self.settings, **changed), spp or self.spp)

    def picture(self, spp: int | None = None, **changed: Any) -> Picture:
        """Returns a picture of the example, as linear radiance (h, w, 3). Parameters: as in `sums`."""
        return mean(self.sums(spp, **changed), self.settings.film_exponent)


def strip(name: str, pictures: dict[str, Picture], columns: int, exposure: float = 0.0, curve: str = "srgb") -> None:
    """Writes several pictures as one labelled contact sheet, a JPEG.

    pictures: the pictures by label. columns: pictures per line. exposure, curve: of the tone mapping.
    """
    font = ImageFont.load_default(size=15)
    height, width = next(iter(pictures.values())).shape[:2]
    rows = -(-len(pictures) // columns)
    gap, label = 6, 26
    sheet = Image.new("RGB", (columns * (width + gap) - gap, rows * (height + label + gap) - gap), "white")
    draw = ImageDraw.Draw(sheet)
    for i, (text, picture) in enumerate(pictures.items()):
        x, y = i % columns * (width + gap), i // columns * (height + label + gap)
        draw.text((x + 2, y + 4), text, fill=(30, 30, 30), font=font)
        sheet.paste(Image.fromarray(apply(picture, exposure, curve)), (x, y + label))
    OUT.mkdir(parents=True, exist_ok=True)
    quality = 88
    while True:
        sheet.save(OUT / f"{name}.jpg", quality=quality, optimize=True, progressive=True)
        if (OUT / f"{name}.jpg").stat().st_size < 250_000 or quality <= 60:
            return
        quality -= 6


def table(title: str, rows: dict[str, float]) -> None:
    """Prints a Markdown table of means, each with its ratio to the first."""
    first = next(iter(rows.values()))
    print(f"\n{title}\n\n| | mean | of the first |\n|---|---|---|")
    for label, value in rows.items():
        print(f"| {label} | {value:.4f} | {value / first:.3f} |")


def smallpt() -> None:
    """Renders smallpt's box of spheres with 8 and with 512 samples per pixel."""
    box = Example("smallpt", 480)
    strip("smallpt", {"8 samples": box.picture(8), "512 samples": box.picture(512)}, 2)


def course_project() -> None:
    """Renders the figures on noise, path depth, Whitted against path tracing, and the causes of dark pictures."""
    box = Example("course-project", 400)
    pictures = {
        "path, 1 sample, depth 3": box.picture(1, max_depth=3),
        "path, 70 samples, depth 12": box.picture(70, max_depth=12),
        "Whitted, 70 samples": box.picture(70, integrator="whitted"),
        "path, 500 samples, depth 12": box.picture(500, max_depth=12),
    }
    strip("course-project", pictures, 2)
    wrong = {
        "path, depth 64": box.picture(128, max_depth=64),
        "depth 12": box.picture(128, max_depth=12),
        "cut at depth 3": box.picture(128, max_depth=3),
        "far light samples dropped": box.picture(128, max_depth=64, mistake="light-cutoff"),
    }
    strip("what-darkens", wrong, 2)
    small = Example("course-project", 96)
    table("What darkens, and what does not (course-project.yaml, 96 x 72)", {
        "path, depth 64": float(small.picture(512, max_depth=64).mean()),
        "Russian roulette at 0.5": float(small.picture(1024, max_depth=64, roulette=0.5).mean()),
        "uniform directions in place of the cosine's": float(small.picture(2048, max_depth=64, sampling="uniform").mean()),
        "cut at depth 12": float(small.picture(512, max_depth=12).mean()),
        "cut at depth 3": float(small.picture(512, max_depth=3).mean()),
        "far light samples dropped": float(small.picture(512, max_depth=64, mistake="light-cutoff").mean()),
        "Whitted, ambient 0": float(small.picture(512, integrator="whitted", ambient=(0.0, 0.0, 0.0)).mean()),
    })  # fmt: skip


def games101() -> None:
    """Renders the Cornell box of GAMES101's assignment with 1, 20 and 200 samples at 784 x 784; shown at half size."""
    box = Example("games101-7", 784)

    def half(picture: Picture) -> Picture:
        return picture.reshape(392, 2, 392, 2, 3).mean((1, 3))

    pictures = {f"{spp} samples" if spp > 1 else "1 sample": box.picture(spp) for spp in (1, 20, 200)}
    strip("games101-7", {label: half(picture) for label, picture in pictures.items()}, 3)
    strip("games101-7-detail", {label: picture[430:690, 200:460] for label, picture in pictures.items()}, 3)


STRATEGIES = ("uniform", "bsdf", "light", "mis")


def strategies() -> None:
    """Renders a scene with each of four light sampling strategies at equal samples, and plots their variance."""
    box = Example("games101-7", 300)
    plain = replace(box.settings, sampler="independent", roulette=0.0, max_depth=6)
    box.settings = plain
    strip("strategies", {f"{s}, 16 samples": box.picture(16, sampling=s) for s in STRATEGIES}, 4)
    box.settings = replace(plain, width=96, height=96)
    counts = [2**k for k in range(2, 8)]
    figure, axes = pyplot.subplots(figsize=(6.4, 4.4), layout="constrained")
    lines = {s: {"sampling": s} for s in STRATEGIES} | {"mis, Sobol'": {"sampling": "mis", "sampler": "sobol"}}
    print("\nVariance of a pixel (games101-7.yaml, 96 x 96, depth 6)\n\n| samples | " + " | ".join(lines) + " |")
    print("|---" * (len(lines) + 1) + "|")
    found = {name: [_variance(box, n, changed) for n in counts] for name, changed in lines.items()}
    for i, n in enumerate(counts):
        print(f"| {n} | " + " | ".join(f"{found[name][i]:.3g}" for name in lines) + " |")
    for name in lines:
        axes.loglog(counts, found[name], marker="o", markersize=4, label=name, base=2)
    axes.loglog(counts, [found["mis"][0] * counts[0] / n for n in counts], "k--", linewidth=0.8, label="1/n", base=2)
    axes.set_xlabel("samples per pixel")
    axes.set_ylabel("variance of a pixel")
    axes.grid(visible=True, alpha=0.3)
    axes.legend()
    OUT.mkdir(parents=True, exist_ok=True)
    figure.savefig(OUT / "variance.png", dpi=110)
    pyplot.close(figure)


def shiny() -> None:
    """Renders glossy spheres with each light sampling strategy, and prints the variances.

    Each strategy without MIS fails on some of the spheres. The variance of MIS with the balance heuristic is printed too.
    """
    balls = Example("spheres", 420)
    strip("strategies-shiny", {f"{s}, 16 samples": balls.picture(16, sampling=s) for s in STRATEGIES}, 2)
    balls = Example("spheres", 160)
    balls.settings = replace(balls.settings, sampler="independent")
    ways = {s: {"sampling": s} for s in STRATEGIES} | {"mis, balance": {"heuristic": "balance"}}
    _variances("Variance of a pixel, 32 samples (spheres.yaml, 160 x 90)", balls, 32, ways)


def light_choices() -> None:
    """Prints the variance of a pixel for three ways to choose one light of many: by contribution, by power, and uniformly."""
    evening = Example("christmas/christmas", 160)
    evening.settings = replace(evening.settings, sampler="independent")
    ways = {choice: {"light_choice": choice} for choice in LIGHT_CHOICES}
    _variances("Variance of a pixel, 32 samples (christmas.yaml, 160 wide)", evening, 32, ways)


def _variances(title: str, example: Example, spp: int, ways: dict[str, dict[str, Any]]) -> None:
    print(f"\n{title}\n\n| " + " | ".join(ways) + " |\n" + "|---" * len(ways) + "|")
    print("| " + " | ".join(f"{_variance(example, spp, changed):.3g}" for changed in ways.values()) + " |")


def _variance(example: Example, spp: int, changed: dict[str, Any]) -> float:
    pictures = np.array([example.picture(spp, seed=seed, **changed) for seed in range(4)], np.float64)
    return float(pictures.var(0, ddof=1).mean())


def attenuation() -> None:
    """Renders the correct picture, and beside it a wrong one whose radiance is divided once more by the squared distance."""
    box = Example("cornell-box", 300)
    right, wrong = box.picture(128), box.picture(128, mistake="attenuation")
    brightened = wrong * (right.mean() / wrong.mean())
    pictures = {"as it is": right, "radiance / d^2, as it comes": wrong, "radiance / d^2, brightened": brightened}
    strip("attenuation", pictures, 3)
    table("Attenuation on top of radiance", {"as it is": float(right.mean()), "radiance / d^2": float(wrong.mean())})


def roulette() -> None:
    """Compares truncation of paths with Russian roulette of constant probability: prints means and variances."""
    box = Example("games101-7", 128)
    box.settings = replace(box.settings, sampler="independent")
    rows = {
        "by throughput": {"roulette": 0.0, "max_depth": 64},
        "by throughput, from 0.15": {"roulette": 0.0, "roulette_floor": 0.15, "max_depth": 64},
        "constant 0.8": {"roulette": 0.8, "max_depth": 64},
        "constant 0.5": {"roulette": 0.5, "max_depth": 64},
        "constant 0.2": {"roulette": 0.2, "max_depth": 64},
        "cut at 3 segments": {"roulette": 1.0, "max_depth": 3},
        "cut at 5 segments": {"roulette": 1.0, "max_depth": 5},
    }
    print(
        "\nRussian roulette and cuts (games101-7.yaml, 128 x 128, 256 samples)\n\n| | mean | variance of a pixel |\n|---|---|---|"
    )
    for label, changed in rows.items():
        pictures = np.array([box.picture(256, seed=seed, **changed) for seed in range(4)], np.float64)
        print(f"| {label} | {pictures.mean():.4f} | {pictures.var(0, ddof=1).mean():.3g} |")


def christmas() -> None:
    """Renders the Christmas scene, and the detail around its brightest pixels twice.

    In one detail each channel is clipped by itself; in the other, colours are scaled down until no channel exceeds 1.
    """
    scene = Example("christmas/christmas", 960)
    picture = scene.picture(256)
    strip("christmas", {"256 samples": picture}, 1, curve="neutral")
    detail = picture[150:390, 300:620]
    scaled = detail / np.maximum(detail.max(axis=2, keepdims=True), 1)
    strip("overflow", {"each channel clipped": detail, "scaled by the greatest channel": scaled}, 2)


def rest_of_your_life() -> None:
    """Renders the box of the book "Ray Tracing: The Rest of Your Life" with three samplers.

    They are BSDF sampling, the book's mixture density (its targets: the light and the glass ball), and MIS.
    """
    box = Example("rest-of-your-life", 360)
    strip("rest-of-your-life", {
        "bsdf alone, 64 samples": box.picture(64, sampling="bsdf"),
        "mixture: light and glass, 64 samples": box.picture(64),
        "mis, 64 samples": box.picture(64, sampling="mis"),
        "mixture, 500 samples": box.picture(500),
    }, 2)  # fmt: skip


FIGURES = (
    smallpt,
    course_project,
    games101,
    strategies,
    shiny,
    light_choices,
    attenuation,
    roulette,
    christmas,
    rest_of_your_life,
)


def main() -> None:
    """Makes the figures named on the command line, or all."""
    wanted = sys.argv[1:]
    for figure in FIGURES:
        if not wanted or figure.__name__ in wanted:
            figure()


if __name__ == "__main__":
    main()
