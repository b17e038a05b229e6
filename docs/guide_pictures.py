"""Renders the small pictures that show one concept each in the guides, in this process: some minutes on two cores.

    python docs/guide_pictures.py [name ...]

Each picture is a row of panels, one for each value of a setting.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

import rayfarm
from renderer.image.read import read
from renderer.image.tonemap import Curve, apply, apply_straight

__all__ = ["main"]

ROOT = Path(__file__).parent.parent
PICTURES = Path(__file__).parent / "pictures"
GAP = 8  # pixels between panels, white
CHECKS = (205, 245)  # greys of the board behind transparent pictures
BOARD = 12  # pixels a square
ID_COLORS = ((20, 20, 28), (60, 64, 78), (230, 90, 70), (240, 190, 70), (80, 150, 220))  # of nothing, the floor and three poles

Panel = npt.NDArray[np.uint8]  # (height, width, 3)

BALLS: dict[str, Any] = {
    "cameras": [
        {"name": "perspective", "eye": [0, 1.5, 5.4], "target": [0, 0.55, 0], "fov": 30},
        {"name": "wide", "eye": [0, 1.0, 2.6], "target": [0, 0.55, 0], "fov": 75},
        {"name": "lens", "eye": [2.4, 1.1, 4.2], "target": [0.2, 0.5, 0.2], "fov": 30, "aperture": 0.14, "focus": [0, 0.6, 0.5]},
        {"name": "plan", "eye": [0, 9, 0], "target": [0, 0, 0], "up": [0, 0, -1], "projection": "orthographic", "height": 3.4},
    ],
    "materials": {
        "floor": {"color": 0.5},
        "gold": {"kind": "conductor", "metal": "gold", "roughness": 0.15},
        "coral": {"kind": "metallic_roughness", "color": "#e0503a", "roughness": 0.3},
        "glass": {"kind": "glass", "ior": 1.5},
    },
    "shapes": [
        {"type": "quad", "material": "floor", "transform": [{"scale": 30}, {"rotate": {"axis": "x", "degrees": -90}}]},
        {"type": "sphere", "material": "gold", "center": [-1.15, 0.6, -0.3], "radius": 0.6},
        {"type": "sphere", "material": "coral", "center": [0, 0.6, 0.5], "radius": 0.6},
        {"type": "sphere", "material": "glass", "center": [1.15, 0.6, -0.3], "radius": 0.6},
    ],
}
STRIPS: dict[str, Any] = {
    "cameras": [{"eye": [0.35, 0.9, 5.2], "target": [0.35, 0.72, 0], "fov": 31}],
    "materials": {
        "floor": {"color": 0.5},
        "strip": {"color": 0, "emission": 6, "double_sided": True},
        "lamp": {"color": 0, "emission": 14, "emission_temperature": 5000},
        "prism": {"kind": "glass", "ior": 1.5, "dispersion": 4.0},
        "gold": {"kind": "conductor", "metal": "gold", "roughness": 0.1},
        "copper": {"kind": "conductor", "metal": "copper", "roughness": 0.1},
        "bubble": {
            "kind": "metallic_roughness",
            "color": 0,
            "metallic": 1,
            "roughness": 0.05,
            "iridescence": 1,
            "iridescence_ior": 1.33,
            "iridescence_thickness": [380, 380],
        },
    },
    "environment": {"color": 0.04},
    "shapes": [
        {"type": "quad", "material": "floor", "transform": [{"scale": 30}, {"rotate": {"axis": "x", "degrees": -90}}]},
        *(
            {"type": "quad", "material": "strip", "transform": [{"scale": [0.02, 1.6, 1]}, {"translate": [x, 1.2, -2.6]}]}
            for x in (-1.2, -0.45, 0.3)
        ),
        {
            "type": "quad",
            "material": "lamp",
            "transform": [{"scale": 0.7}, {"rotate": {"axis": "x", "degrees": 90}}, {"translate": [0.6, 3.4, 1.4]}],
        },
        {"type": "sphere", "material": "prism", "center": [-0.35, 0.85, 0], "radius": 0.85},
        {"type": "sphere", "material": "gold", "center": [1.3, 0.45, -0.5], "radius": 0.45},
        {"type": "sphere", "material": "copper", "center": [0.72, 0.24, 0.85], "radius": 0.24},
        {"type": "sphere", "material": "bubble", "center": [1.35, 0.3, 0.75], "radius": 0.3},
    ],
}
SMALL: dict[str, Any] = {"width": 288, "height": 192, "spp": 96, "max_depth": 8, "denoise": True}


def environments() -> list[Panel]:
    """Returns the same balls by each preset of light."""
    presets = ("studio", "dark-studio", "overcast", "low-sun", "morning", "noon")
    return [_shown(rayfarm.render(BALLS, environment=preset, **SMALL)["denoised"], "neutral") for preset in presets]


def cameras() -> list[Panel]:
    """Returns the same balls by a long lens, a wide one, one with an aperture, and from above without perspective."""
    return [
        _shown(rayfarm.render(BALLS, environment="studio", camera=camera["name"], **SMALL)["denoised"], "neutral")
        for camera in BALLS["cameras"]
    ]


def tone_curves() -> list[Panel]:
    """Returns one picture, two stops brighter than exposed well, by each tone curve."""
    light = rayfarm.render(BALLS, environment="noon", **SMALL)["denoised"]
    return [_shown(light, curve, exposure=0.7) for curve in ("srgb", "reinhard", "filmic", "neutral", "agx")]


def backgrounds() -> list[Panel]:
    """Returns the balls opaque, and on a board before a transparent background: without the floor, and with its shadows."""
    bare = BALLS | {"shapes": BALLS["shapes"][1:]}
    caught = BALLS | {"materials": BALLS["materials"] | {"floor": {"color": 0.5, "shadow_catcher": True}}}
    settings = SMALL | {"environment": "noon", "spp": 192}
    opaque = _shown(rayfarm.render(BALLS, **settings)["denoised"], "neutral")
    return [opaque, *(_on_board(rayfarm.render(each, background="transparent", **settings)) for each in (bare, caught))]


def reflection_catcher() -> list[Panel]:
    """Returns balls on a glossy floor, what a catcher of shadows and reflections has of them, and that over a plate."""
    floor = {"kind": "metallic_roughness", "color": 0.35, "roughness": 0.08}
    catcher = floor | {"shadow_catcher": True, "reflection_catcher": True}
    whole, caught = (BALLS | {"materials": BALLS["materials"] | {"floor": each}} for each in (floor, catcher))
    bare = whole | {"shapes": BALLS["shapes"][:1]}
    settings = SMALL | {"environment": "studio", "spp": 128}
    picture = rayfarm.render(caught, background="transparent", **settings)
    plate = rayfarm.render(bare, **settings)["denoised"]
    composite = picture["denoised"] + (1 - picture["alpha"][..., None]) * plate
    opaque = _shown(rayfarm.render(whole, **settings)["denoised"], "neutral")
    return [opaque, _on_board(picture), _shown(composite, "neutral")]


def motion_blur() -> list[Panel]:
    """Returns a frame of the caterpillar's shot with the shutter closed, open for half of a frame, and for two frames."""
    scene = ROOT / "scenes" / "caterpillar" / "caterpillar.yaml"
    settings: dict[str, Any] = {"frame": 20, "width": 320, "height": 180, "spp": 48, "denoise": True}
    return [_shown(rayfarm.render(scene, shutter=shutter, **settings)["denoised"], "neutral") for shutter in (0, 0.5, 2)]


def rolling_shutter() -> list[Panel]:
    """Returns poles that fly by, with the whole picture exposed at once, by a rolling shutter, and its ids as colours."""
    poles = [
        {
            "type": "cube",
            "name": f"pole-{i}",
            "material": name,
            "transform": [
                {"scale": [0.08, 1.2, 0.08]},
                {"translate": {"keys": [[0, [x - 2.2, 1.2, z]], [1, [x + 2.2, 1.2, z]]]}},
            ],
        }
        for i, (name, x, z) in enumerate((("coral", -0.9, 0.4), ("gold", 0.3, 0.0), ("coral", 1.3, -0.6)))
    ]
    scene = BALLS | {"shapes": [*BALLS["shapes"][:1], *poles]}
    pose = np.eye(4)
    pose[:3, 3] = 0, 1.2, 6.2
    size = {name: SMALL[name] for name in ("width", "height")} | {"fps": 2}
    found = []
    for rolling in (0.0, 0.97):
        with tempfile.TemporaryDirectory() as folder:
            rayfarm.dataset(
                *(scene, [pose] * 2),
                **size,
                folder=Path(folder) / "poles",
                fov=30,
                outputs=["color", "object"],
                picture_format="exr",
                environment="studio",
                spp=256,
                shutter=0.6,
                rolling_shutter=rolling,
            )
            light = read((Path(folder) / "poles/color/000001.exr").read_bytes(), "color.exr")
            ids = np.load(Path(folder) / "poles/object/000001.npy")
        found.append(_shown(light[..., :3], "neutral"))
    return [*found, np.array(ID_COLORS, np.uint8)[ids]]


def spectral() -> list[Panel]:
    """Returns a dispersive ball before strips of light, gold, copper and a soap film, in RGB and by wavelength."""
    settings: dict[str, Any] = {"width": 380, "height": 340, "spp": 96, "max_depth": 10, "denoise": True}
    return [_shown(rayfarm.render(STRIPS, spectral=each, **settings)["denoised"], "neutral") for each in ("off", "on")]


def denoising() -> list[Panel]:
    """Returns a still life at 8 samples a pixel, the same denoised, and at 256 samples."""
    scene = ROOT / "scenes" / "still-life.yaml"
    few = rayfarm.render(scene, width=320, height=200, spp=8, denoise=True)
    many = rayfarm.render(scene, width=320, height=200, spp=256)
    return [_shown(light, "neutral") for light in (few["color"], few["denoised"], many["color"])]


def _shown(light: npt.NDArray[np.float32], curve: Curve, exposure: float = 0.0) -> Panel:
    return apply(np.maximum(light, 0), exposure, curve)


def _on_board(image: rayfarm.Image) -> Panel:
    """Returns a picture with alpha on a board of two greys. The colour is premultiplied and scene-linear."""
    light = image["color"]
    height, width = light.shape[:2]
    shown = apply_straight(light, image["alpha"].reshape(height, width))
    colour, alpha = shown[..., :3], shown[..., 3:] / 255
    y, x = np.mgrid[0:height, 0:width] // BOARD
    board = np.where((x + y) % 2, *CHECKS)[..., None]
    return (colour * alpha + board * (1 - alpha) + 0.5).astype(np.uint8)


def _joined(panels: Sequence[Panel], columns: int) -> Image.Image:
    """Returns panels of one size in rows of `columns`, with white gaps."""
    height, width = panels[0].shape[:2]
    rows = -(-len(panels) // columns)
    sheet = Image.new("RGB", (columns * (width + GAP) - GAP, rows * (height + GAP) - GAP), "white")
    for i, panel in enumerate(panels):
        sheet.paste(Image.fromarray(panel), (i % columns * (width + GAP), i // columns * (height + GAP)))
    return sheet


DRAWN: dict[str, tuple[Callable[[], list[Panel]], int]] = {
    "environments": (environments, 3),
    "cameras": (cameras, 2),
    "tone-curves": (tone_curves, 5),
    "backgrounds": (backgrounds, 3),
    "reflection-catcher": (reflection_catcher, 3),
    "denoising": (denoising, 3),
    "motion-blur": (motion_blur, 3),
    "spectral": (spectral, 2),
    "rolling-shutter": (rolling_shutter, 3),
}


def main() -> None:
    """Parses the command line, and renders the pictures that it names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="name", help=f"{', '.join(DRAWN)}; all unless told")
    names = parser.parse_args().names or list(DRAWN)
    if not set(names) <= set(DRAWN):
        parser.error(f"pictures are {', '.join(DRAWN)}")
    for name in names:
        draw, columns = DRAWN[name]
        path = PICTURES / f"{name}.webp"
        _joined(draw(), columns).save(path, quality=85, method=6)
        print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
