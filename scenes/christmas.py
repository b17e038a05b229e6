"""Writes the folder christmas/: a village on a winter's evening, modelled on the group's renderer in docs/lineage.md.

    python scenes/christmas.py

It consists of OBJ files with a shared material file, placed by a tree of transforms; all of it is this project's own.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scene_text import Scene, Shape, sphere, text_of
from village_meshes import EAVES, HALF_DEPTH, HALF_WIDTH, POND, RIDGE, chimney, fir, ground, hat, height, house, snowman, star
from village_pictures import pictures

__all__ = ["files"]

HERE = Path(__file__).parent
COMMENT = "A village in the snow: trees, houses and a snowman, hundreds of small lights, and a moon behind the camera."

MTL = """# Written by scenes/christmas.py.
newmtl snow
Kd .86 .88 .92
newmtl needles
Kd .02 .075 .035
newmtl bark
Kd .07 .04 .025
newmtl bricks
Kd 1 1 1
map_Kd bricks.png
newmtl sooty bricks
Kd .7 .72 .76
map_Kd -s 1 1 1 bricks.png
decal soot.png
newmtl tiles
Kd .16 .05 .04
newmtl frame
Kd .62 .6 .55
newmtl door
Kd .03 .09 .055
Ks .25 .25 .25
Ns 60
newmtl wool
Kd 1 1 1
map_Kd wool.png
newmtl coal
Kd .02 .02 .02
newmtl carrot
Kd .75 .2 .02
newmtl felt
Kd .018 .018 .022
newmtl starlight
Kd 0 0 0
Ke 22 14 4
newmtl ribbon
Kd .45 .02 .025
"""

TREE = (-2.75, 0.9)
LAMPS = {"red": [30, 3, 2], "green": [3, 22, 5], "blue": [3, 7, 34], "yellow": [30, 20, 4], "white": [24, 22, 20]}
BALLS = ("gold", "silver", "copper", "mirror", "ruby")
HOUSES = (
    (-0.8, -5.0, 34.0, 1.0),
    (4.4, -6.6, -40.0, 1.05),
    (-6.0, -9.4, 48.0, 1.1),
    (1.8, -12.2, -28.0, 1.0),
)  # x, z, turn, size


def files() -> dict[str, str | np.ndarray]:
    """Returns the folder's files: text, and images as (h, w, 3 or 4) uint8."""
    random = np.random.default_rng(1224)
    return {
        "village.mtl": MTL,
        "ground.obj": ground(),
        "fir.obj": fir(np.random.default_rng(12)),
        **house(),
        "chimney.obj": chimney(),
        "snowman.obj": snowman(),
        "hat.obj": hat(),
        "star.obj": star(),
        **pictures(np.random.default_rng(24)),
        "christmas.yaml": text_of(scene(random), COMMENT, Path(__file__).name),
    }


def scene(random: np.random.Generator) -> Scene:
    """Returns the content of christmas.yaml."""
    return {
        "name": "Christmas",
        "settings": {"width": 960, "height": 600, "spp": 32, "max_depth": 10},
        "cameras": [{"name": "front", "eye": [0.5, 2.15, 9.4], "target": [0.1, 1.5, 0], "fov": 37}],
        "environment": {"image": "sky.png", "strength": 1.3},
        "textures": {
            "bricks": {"image": "bricks.png"},
            "grime": {"image": "grime.png", "scale": [0.3, 0.55], "offset": [0.1, 0.45], "wrap": ["repeat", "clamp"]},
            "frost": {"image": "frost.png", "scale": [0.45, 0.7], "offset": [0, 0.3], "wrap": ["repeat", "clamp"]},
            "panes": {"image": "panes.png", "wrap": "clamp"},
            "curtains": {"image": "curtains.png", "wrap": "clamp"},
            "ice": {"image": "ice.png"},
            "drift": {"image": "drift.png", "wrap": "clamp"},
        },
        "materials": _materials(),
        "shapes": [
            {"name": "ground", "type": "mesh", "file": "ground.obj"},
            _pond(),
            {"name": "village", "type": "group", "shapes": [_house(), _lantern()]},
            _forest(random),
            _tree(random),
            _snowman(),
            *_balls(),
            *_flakes(random),
            sphere("moon behind the camera", "moon", (-8.5, 10, 15), 3.0),
        ],
    }


def _materials() -> dict[str, Any]:
    found: dict[str, Any] = {
        "walls": {"texture": ["bricks", {"texture": "grime", "blend": "multiply", "strength": 0.8}, "frost"]},
        "ice": {"texture": ["ice", {"texture": "drift", "strength": 0.85}], "roughness": 0.06},
        "gold": {"kind": "conductor", "metal": "gold", "roughness": 0.12},
        "silver": {"kind": "conductor", "metal": "silver", "roughness": 0.05},
        "copper": {"kind": "conductor", "metal": "copper", "roughness": 0.2},
        "mirror": {"kind": "mirror", "color": 0.95},
        "ruby": {"color": [0.5, 0.012, 0.02], "roughness": 0.15, "clearcoat": 1, "clearcoat_roughness": 0.03, "metallic": 0.6},
        "glass": {"kind": "glass", "ior": 1.5},
        "flake": {"color": 0.9},
        "iron": {"color": 0.03, "roughness": 0.5},
        "moon": {"color": 0, "emission": [22, 25, 31]},
        "windows": {
            "color": 0,
            "emission": [11, 10, 9],
            "emission_texture": ["panes", {"texture": "curtains", "blend": "multiply"}],
        },
        "drifted": {"color": [0.86, 0.88, 0.92]},
        "lantern": {"color": 0, "emission": [26, 15, 6]},
    }
    return found | {f"lamp {name}": {"color": 0, "emission": list(radiance)} for name, radiance in LAMPS.items()}


def _at(x: float, z: float, turn: float = 0.0, size: float | list[float] = 1.0, sunk: float = 0.0) -> list[dict[str, Any]]:
    """Returns the transform of an object on the snow."""
    place = [round(x, 3), round(height(x, z) - sunk, 3), round(z, 3)]
    return [{"scale": size}, {"rotate": {"axis": "y", "degrees": round(turn, 1)}}, {"translate": place}]


def _pond() -> Shape:
    flat = [{"rotate": {"axis": "x", "degrees": -90}}, {"scale": [POND[2] * 1.3, 1, POND[3] * 1.3]}]
    return {"name": "pond", "type": "disk", "material": "ice", "transform": [*flat, {"translate": [POND[0], 0.0, POND[1]]}]}


def _house() -> Shape:
    """Returns a house with walls, windows, doors, roof, chimney and lights along the eaves; instanced for each of HOUSES."""
    bulbs: list[Shape] = []
    for name, place in zip(LAMPS, range(len(LAMPS)), strict=True):
        along = [i for i in range(25) if i % len(LAMPS) == place]
        bulbs.append(_bulbs(f"{name} bulbs", f"lamp {name}", [_garland(i / 24) for i in along], 0.024))
    return {
        "name": "house",
        "type": "group",
        "instances": [_at(x, z, turn, size, 0.12) for x, z, turn, size in HOUSES],
        "shapes": [
            {"name": "walls", "type": "mesh", "file": "walls.obj", "material": "walls"},
            {"name": "windows", "type": "mesh", "file": "windows.obj", "material": "windows"},
            {"name": "joinery", "type": "mesh", "file": "joinery.obj"},
            {
                "name": "roof",
                "type": "group",
                "shapes": [
                    {"name": "tiles", "type": "mesh", "file": "roof.obj"},
                    {"name": "chimney", "type": "mesh", "file": "chimney.obj", "transform": [{"translate": [0.75, 2.75, -0.5]}]},
                ],
            },
            {"name": "garland", "type": "group", "shapes": bulbs},
        ],
    }


def _garland(t: float) -> list[float]:
    """Returns a point of the garland along the gable for t in 0..1, sagging between nails."""
    across = (2 * t - 1) * (HALF_WIDTH + 0.2)
    slope = (RIDGE - EAVES) / HALF_WIDTH
    y = RIDGE - slope * abs(across) - 0.13 - 0.04 * abs(math.sin(4 * math.pi * t))
    return [round(across, 3), round(y, 3), round(HALF_DEPTH + 0.3, 3)]


def _bulbs(name: str, material: str, places: list[list[float]], radius: float) -> Shape:
    instances = [[{"translate": place}] for place in places]
    return {"name": name, "type": "sphere", "material": material, "radius": radius, "instances": instances}


def _lantern() -> Shape:
    """Returns an iron post with a lamp, and snow on its roof."""
    post = [[0, -0.3], [0.06, -0.3], [0.05, 0.3], [0.028, 0.36], [0.026, 1.5], [0.1, 1.56], [0.1, 1.58], [0, 1.58]]
    roof = [[0.14, 1.84], [0.15, 1.86], [0.03, 1.98], [0, 2.0]]
    cap = [[0.15, 1.865], [0.14, 1.9], [0.05, 2.0], [0, 2.03]]
    return {
        "name": "lantern",
        "type": "group",
        "instances": [_at(x, z) for x, z in ((-2.3, -1.9), (3.1, -2.6), (2.2, -7.2))],
        "shapes": [
            {"name": "post", "type": "lathe", "material": "iron", "profile": post, "segments": 16},
            {"name": "lamp", "type": "sphere", "material": "lantern", "center": [0, 1.71, 0], "radius": 0.1},
            {"name": "roof", "type": "lathe", "material": "iron", "profile": roof, "segments": 16},
            {"name": "snow", "type": "lathe", "material": "drifted", "profile": cap, "segments": 16},
        ],
    }


def _forest(random: np.random.Generator) -> Shape:
    """Returns firs on the hills and at the sides: one mesh with many instances."""
    places: list[tuple[float, float]] = []
    instances = []
    for _ in range(4000):
        x, z = float(random.uniform(-19, 20)), float(random.uniform(-34, 1.5))
        open_ground = abs(x - 0.4) < 4.4 - 0.13 * z and z > -13.5
        near_tree = math.hypot(x - TREE[0], z - TREE[1]) < 3.4
        near_house = any(math.hypot(x - a, z - b) < 3.3 for a, b, _, _ in HOUSES)
        size = float(random.uniform(0.75, 1.45))
        if open_ground or near_tree or near_house or any(math.hypot(x - a, z - b) < 1.5 for a, b in places) or len(places) == 120:
            continue
        places.append((x, z))
        wide = round(size * float(random.uniform(0.85, 1.1)), 2)
        instances.append(_at(x, z, float(random.uniform(0, 360)), [wide, round(size, 2), wide], 0.08))
    return {"name": "forest", "type": "mesh", "file": "fir.obj", "instances": instances}


def _tree(random: np.random.Generator) -> Shape:
    """Returns the fir by the pond, with balls, bulbs and a star."""
    hung: dict[tuple[str, float], list[list[float]]] = {}
    for i in range(120):
        t = float(random.uniform(0, 0.96)) ** 1.15
        reach = (1.12 * (1 - t) ** 0.9 + 0.14) * float(random.uniform(0.62, 0.97))
        turn = 2.399963 * i
        drop = 0.34 - 0.25 * t
        y = 0.42 + 2.3 * t + 0.1 * reach - 1.6 * drop * reach * reach / (1.12 * (1 - t) ** 0.9 + 0.14)
        ball = i % 3 == 0
        place = [round(reach * math.cos(turn), 3), round(y + (-0.06 if ball else 0.05), 3), round(reach * math.sin(turn), 3)]
        kind = (BALLS[i // 3 % len(BALLS)], 0.055) if ball else (f"lamp {list(LAMPS)[i % len(LAMPS)]}", 0.016)
        hung.setdefault(kind, []).append(place)
    trimmings = [_bulbs(material, material, places, radius) for (material, radius), places in hung.items()]
    return {
        "name": "christmas tree",
        "type": "group",
        "transform": _at(*TREE, 20, 1.12, 0.05),
        "shapes": [
            {"name": "fir", "type": "mesh", "file": "fir.obj"},
            {"name": "trimmings", "type": "group", "shapes": trimmings},
            {"name": "star", "type": "mesh", "file": "star.obj", "transform": [{"translate": [0, 3.12, 0]}]},
        ],
    }


def _snowman() -> Shape:
    worn = [{"rotate": {"axis": "z", "degrees": -9}}, {"translate": [0.02, 1.585, -0.01]}]
    return {
        "name": "snowman",
        "type": "group",
        "transform": _at(3.05, 1.0, -22, 1.0, 0.05),
        "shapes": [
            {"name": "body", "type": "mesh", "file": "snowman.obj"},
            {"name": "hat", "type": "mesh", "file": "hat.obj", "transform": worn},
        ],
    }


def _balls() -> list[Shape]:
    """Returns metal and glass balls in the snow in front of the tree."""
    lying = (
        ("gold", -1.5, 3.3, 0.24),
        ("mirror", -2.3, 3.35, 0.34),
        ("ruby", -1.15, 4.2, 0.19),
        ("copper", -1.85, 4.35, 0.21),
        ("glass", 2.3, 4.3, 0.21),
        ("silver", 2.85, 3.85, 0.26),
    )
    return [sphere(f"{kind} ball", kind, (x, height(x, z) + 0.8 * r, z), r) for kind, x, z, r in lying]


def _flakes(random: np.random.Generator) -> list[Shape]:
    """Returns snowflakes: hundreds of tiny spheres of several materials."""
    shares = {"flake": 0.8, "glass": 0.07, "mirror": 0.09, "lamp white": 0.04}
    made = []
    for kind, share in shares.items():
        for radius in (0.012, 0.018, 0.026):
            count = round(600 * share / 3)
            deepest = 5.5 if radius < 0.02 else 3.0  # none close enough to fill the picture
            places = random.uniform((-8, 0.4, -9), (8, 6.0, deepest), (count, 3))
            size = 0.6 * radius if kind == "lamp white" else radius
            made.append(_bulbs(f"{kind} snow", kind, [[round(float(c), 2) for c in place] for place in places], round(size, 4)))
    return made


def main() -> None:
    """Writes the folder beside this script."""
    folder = HERE / "christmas"
    folder.mkdir(exist_ok=True)
    for name, content in files().items():
        if isinstance(content, str):
            (folder / name).write_text(content)
        else:
            Image.fromarray(content).save(folder / name, optimize=True)


if __name__ == "__main__":
    main()
