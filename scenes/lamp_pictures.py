"""Renders the picture of shaped lights in docs/scene-format-lights.md: python -m scenes.lamp_pictures

A corner with three downlights with analytic IES profiles, a window image projected by a spot, and a projector.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from renderer.film import mean
from renderer.image import encode
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, chosen

ROOT = Path(__file__).parent.parent
PICTURE = ROOT / "docs" / "pictures" / "lamps.jpg"
WIDTH, HEIGHT, SPP = 1200, 500, 96


def _ies(candela: Any) -> str:
    """Returns a rotationally symmetric IES profile. candela: function of the angle from the axis, in degrees."""
    angles = np.arange(0, 181, 1.0)
    rows = [" ".join(f"{v:g}" for v in values) for values in (angles, [0.0], candela(angles))]
    return "\n".join(["IESNA:LM-63-2002", "TILT=NONE", f"1 -1 1 {len(angles)} 1 1 2 0 0 0", "1 1 10", *rows]) + "\n"


def _window() -> np.ndarray:
    """Returns an image of a window with four panes."""
    y, x = np.mgrid[0:256, 0:256] / 256
    lit = (abs(x - 0.5) < 0.28) & (abs(y - 0.5) < 0.36) & (abs(x - 0.5) > 0.015) & (abs(y - 0.42) > 0.015)
    return np.repeat((255 * lit).astype(np.uint8)[..., None], 3, axis=2)


PROFILES = {
    "narrow.ies": lambda a: 5200 * np.exp(-((a / 11) ** 2)) + 150 * (a < 60),
    "batwing.ies": lambda a: np.where(a < 85, 60 + 420 * np.exp(-(((a - 32) / 7) ** 2)), 0),
    "both.ies": lambda a: 1500 * np.exp(-((a / 24) ** 2)) + 1900 * np.exp(-(((a - 180) / 20) ** 2)) + 25,
}
SCENE = {
    "cameras": [{"name": "front", "eye": [0, 1.5, 6.2], "target": [0, 1.35, 0], "fov": 27}],
    "environment": {"color": 0.02},
    "lights": [
        *(
            {"type": "point", "name": file, "position": [x, 2.45 if file != "both.ies" else 1.5, 0.22], "profile": file}
            | {"intensity": 1.6, "color": [1, 0.86, 0.7]}
            for x, file in ((-2.75, "narrow.ies"), (-1.85, "batwing.ies"), (-0.95, "both.ies"))
        ),
        {"type": "spot", "position": [-0.6, 2.6, 2.6], "target": [0.55, 1.35, 0], "picture": "window.png", "outer_cone": 17}
        | {"inner_cone": 16.5, "intensity": [26, 22, 15], "radius": 0.015},
        {"type": "projector", "position": [2.35, 1.5, 4.0], "target": [2.35, 1.5, 0], "picture": "slide.jpg", "fov": 17}
        | {"intensity": 55},
    ],
    "materials": {"wall": {"color": [0.75, 0.74, 0.72]}, "floor": {"color": [0.35, 0.3, 0.27]}, "ball": {"color": 0.6}},
    "shapes": [
        {"type": "quad", "material": "wall", "transform": [{"scale": [6, 4, 1]}]},
        {"type": "quad", "material": "floor", "transform": [{"scale": [6, 6, 1]}, {"rotate": {"axis": "x", "degrees": -90}}]},
        {"type": "sphere", "material": "ball", "center": [0.35, 0.3, 0.55], "radius": 0.3},
    ],
    "settings": {"max_depth": 6},
}


def make() -> None:
    """Renders and writes the picture."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, candela in PROFILES.items():
            (folder / file).write_text(_ies(candela))
        Image.fromarray(_window()).save(folder / "window.png")
        Image.open(ROOT / "docs" / "pictures" / "still-life.jpg").resize((960, 540)).save(folder / "slide.jpg")
        (folder / "lamps.yaml").write_text(json.dumps(SCENE))
        found = read(folder, "lamps.yaml")
    settings = RenderSettings(WIDTH, HEIGHT, found.cameras[0].view, **chosen({}, found.defaults))
    sums = render_frame(compile_scene(found), settings, SPP)
    encode.write(PICTURE, mean(sums, settings.film_exponent))


if __name__ == "__main__":
    make()
