"""Renders the picture sheets: a row of balls for each material, one parameter swept from left to right.

    python3 farm.py sheets [name ...] [-o docs/pictures/sheets] [--spp 128]

They are for visual inspection: whether a sweep is even where it should be, and whether anything breaks at its ends.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from renderer.film import mean
from renderer.image.tonemap import apply
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Image, Instance, Material, Mesh, SceneDescription, Sphere, Texture
from renderer.scene.readers.metals import METALS
from renderer.scene.studio import studio_image
from renderer.settings import RenderSettings, View

__all__ = ["SHEETS", "main"]

TILE = 132  # pixels
LABEL = 20
DEFAULT = Path(__file__).parent.parent / "docs" / "pictures" / "sheets"
VIEW = View((0.0, 1.3, 5.2), (0.0, -0.03, 0.0), fov=29.0)

Sweep = Sequence[tuple[str, Material]]  # the label and the material of each ball
SHEETS: dict[str, Callable[[], Sweep]] = {}


def _sheet(build: Callable[[], Sweep]) -> Callable[[], Sweep]:
    SHEETS[build.__name__.strip("_").replace("_", "-")] = build
    return build


def _sweep(field: str, values: Sequence[Any], label: str = "{:g}", **fixed: Any) -> Sweep:
    fixed = {"kind": "metallic_roughness", "base_color": (0.75, 0.1, 0.07), "roughness": 0.3} | fixed
    return [(label.format(value), Material(**(fixed | {field: value}))) for value in values]


_TENTHS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0)
_WHITE = (1.0, 1.0, 1.0)
_GOLD = (1.0, 0.766, 0.336)


@_sheet
def plastic_roughness() -> Sweep:
    return _sweep("roughness", _TENTHS)


@_sheet
def metal_roughness() -> Sweep:
    return _sweep("roughness", _TENTHS, base_color=_GOLD, metallic=1.0)


@_sheet
def metallic() -> Sweep:
    return _sweep("metallic", _TENTHS, base_color=_GOLD)


@_sheet
def named_metals() -> Sweep:
    return [(name, Material(kind="conductor", eta=eta, k=k, roughness=0.15)) for name, (eta, k) in list(METALS.items())[:8]]


@_sheet
def ior() -> Sweep:
    return _sweep("ior", (1.0, 1.2, 1.33, 1.5, 1.8, 2.2, 3.0), roughness=0.1)


@_sheet
def specular_factor() -> Sweep:
    return _sweep("specular", _TENTHS, roughness=0.15, base_color=(0.05, 0.08, 0.3))


@_sheet
def clearcoat() -> Sweep:
    return _sweep("clearcoat", _TENTHS, roughness=0.7, clearcoat_roughness=0.03, metallic=0.6)


@_sheet
def clearcoat_roughness() -> Sweep:
    return _sweep("clearcoat_roughness", _TENTHS, roughness=0.7, clearcoat=1.0, metallic=0.6)


@_sheet
def sheen_roughness() -> Sweep:
    return _sweep(
        "sheen_roughness",
        (0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0),
        roughness=1.0,
        base_color=(0.1, 0.02, 0.15),
        sheen_color=(0.7, 0.6, 0.9),
    )


@_sheet
def transmission() -> Sweep:
    return _sweep("transmission", _TENTHS, roughness=0.0, base_color=(0.4, 0.8, 0.6))


@_sheet
def glass_roughness() -> Sweep:
    return _sweep("roughness", _TENTHS, kind="glass", base_color=_WHITE)


@_sheet
def glass_ior() -> Sweep:
    return _sweep("ior", (1.0, 1.1, 1.33, 1.5, 1.8, 2.1, 2.4), kind="glass", base_color=_WHITE, roughness=0.0)


@_sheet
def thin_glass_roughness() -> Sweep:
    return _sweep("roughness", _TENTHS, kind="glass", base_color=(0.8, 0.9, 1.0), thin=True)


@_sheet
def attenuation_distance() -> Sweep:
    distances = (0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
    return _sweep(
        "attenuation_distance", distances, kind="glass", base_color=_WHITE, roughness=0.0, attenuation_color=(0.9, 0.4, 0.1)
    )


@_sheet
def dispersion() -> Sweep:
    return _sweep("dispersion", (0.0, 0.3, 1.0, 2.0, 4.0, 7.0, 10.0), kind="glass", base_color=_WHITE, roughness=0.0, ior=1.8)


@_sheet
def anisotropy() -> Sweep:
    return _sweep("anisotropy", _TENTHS, base_color=(0.9, 0.9, 0.9), metallic=1.0, roughness=0.35)


@_sheet
def anisotropy_rotation() -> Sweep:
    turns = [i * np.pi / 6 for i in range(7)]
    swept = _sweep("anisotropy_rotation", turns, base_color=(0.9, 0.9, 0.9), metallic=1.0, roughness=0.35, anisotropy=0.9)
    return [(f"{30 * i} deg", material) for i, (_, material) in enumerate(swept)]


@_sheet
def iridescence_thickness() -> Sweep:
    films = [(t, t) for t in (100.0, 200.0, 300.0, 400.0, 550.0, 700.0, 900.0)]
    fixed = {"iridescence": 1.0, "roughness": 0.1, "metallic": 1.0, "base_color": (0.6, 0.6, 0.6)}
    return [
        (f"{film[0]:g} nm", m) for film, (_, m) in zip(films, _sweep("iridescence_thickness", films, "", **fixed), strict=True)
    ]


@_sheet
def iridescence_ior() -> Sweep:
    fixed = {"iridescence": 1.0, "roughness": 0.1, "base_color": (0.02, 0.02, 0.02), "iridescence_thickness": (400.0, 400.0)}
    return _sweep("iridescence_ior", (1.0, 1.15, 1.3, 1.45, 1.6, 1.8, 2.0), **fixed)


@_sheet
def diffuse_transmission() -> Sweep:
    return _sweep(
        "diffuse_transmission", _TENTHS, roughness=1.0, base_color=(0.7, 0.3, 0.2), diffuse_transmission_color=(0.3, 0.8, 0.2)
    )


@_sheet
def opacity() -> Sweep:
    return _sweep("opacity", _TENTHS, alpha_mode="blend")


@_sheet
def blinn_phong_shininess() -> Sweep:
    fixed = {"kind": "blinn_phong", "base_color": (0.4, 0.1, 0.08), "specular_color": (0.4, 0.4, 0.4), "roughness": None}
    return _sweep("shininess", (1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0), **fixed)


def _stage(material: Material) -> SceneDescription:
    """Returns a ball on a checkered floor, lit by the studio preset and a small light."""
    corners = np.array([(-30, -1, 12), (30, -1, 12), (30, -1, -48), (-30, -1, -48)], np.float32)
    uvs = np.array([(0, 0), (30, 0), (30, 30), (0, 30)], np.float32)
    floor = Mesh("floor", corners, np.array([(0, 1, 2), (0, 2, 3)], np.int32), None, uvs, 0)
    checker = np.full((2, 2, 4), 255, np.uint8)
    checker[..., :3] = np.array([[200, 90], [90, 200]])[..., None]
    fine = checker.repeat(16, 0).repeat(16, 1)
    lamp = Material(base_color=(0.0, 0.0, 0.0), emission=(40.0, 38.0, 36.0))
    return SceneDescription(
        meshes=[floor],
        instances=[Instance(0)],
        spheres=[Sphere((0.0, 0.0, 0.0), 1.0, 1), Sphere((-3.0, 5.0, 3.0), 0.5, 2)],
        materials=[Material(base_color=(0.9, 0.9, 0.9), base_color_texture=0), material, lamp],
        textures=[Texture(0)],
        images=[Image("checker", fine), Image("studio", studio_image(), srgb=False)],
        environment=Environment(image=1, strength=0.8),
    )


def render_sheet(name: str, spp: int) -> Picture.Image:
    """Returns a sheet's picture, with labels below the balls."""
    sweep = SHEETS[name]()
    settings = RenderSettings(TILE, TILE, VIEW, max_depth=24)
    sheet = Picture.new("RGB", (TILE * len(sweep), TILE + LABEL), "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(12)
    for i, (label, material) in enumerate(sweep):
        film = render_frame(compile_scene(_stage(material)), settings, spp)
        picture = apply(mean(film, settings.film_exponent))
        sheet.paste(Picture.fromarray(picture), (i * TILE, 0))
        draw.text((i * TILE + TILE // 2, TILE + LABEL // 2), label, "black", font, "mm")
    return sheet


def main() -> None:
    """Parses the command line, and renders the sheets that it names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="name", help="all where none is named")
    parser.add_argument("-o", "--output", type=Path, default=DEFAULT)
    parser.add_argument("--spp", type=int, default=128)
    options = parser.parse_args()
    for name in options.names:
        if name not in SHEETS:
            parser.error(f"there is no sheet {name}; known are {', '.join(SHEETS)}")
    options.output.mkdir(parents=True, exist_ok=True)
    for name in options.names or SHEETS:
        path = options.output / f"{name}.jpg"
        render_sheet(name, options.spp).save(path, quality=88, optimize=True)
        print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
