"""Writes the folder caterpillar/: a shot of four seconds, in which a top circles a toy caterpillar that watches it.

    python scenes/caterpillar.py

The caterpillar is a glTF skin, the top is in nested groups, the camera has keyframes, and the shutter is open for half a frame.
The shot loops. All of it is this project's own; film.py renders the film in docs/.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from caterpillar_meshes import JOINTS, Part, block, body_parts, skin_picture, top_parts
from caterpillar_moves import FPS, FRAMES, bones, camera, top_place, top_turns
from glb import BYTE, SHORT, Glb
from PIL import Image
from scene_text import Scene, Shape, sphere, text_of

__all__ = ["files"]

HERE = Path(__file__).parent
COMMENT = "A four-second shot: a spinning top circles a toy caterpillar, which turns its head after it."
GENERATOR = "scenes/caterpillar.py"
MOMENTS = np.arange(FRAMES) / FPS

WOOD = {"red": (0.62, 0.035, 0.03), "cream": (0.86, 0.72, 0.48), "tip": (0.30, 0.02, 0.03)}
BRICKS = (
    ("mustard", -2.45, 0, -3.3, 24),
    ("blue", -1.1, 0, -3.75, -8),
    ("white", -1.72, 1, -3.5, 14),
    ("mint", 4.6, 0, -3.6, 32),
)  # x, number of blocks below, z, turn
# Colour, roughness, clear coat strength.
TOY = {
    "skin": ((1.0, 1.0, 1.0), 0.42, 0.5),
    "feet": ((0.86, 0.2, 0.03), 0.4, 0.4),
    "white": ((0.9, 0.89, 0.85), 0.2, 1.0),
    "pupil": ((0.012, 0.01, 0.012), 0.2, 1.0),
    "lid": ((0.2, 0.46, 0.06), 0.42, 0.4),
    "cheek": ((0.9, 0.28, 0.2), 0.6, 0.0),
}


def files() -> dict[str, str | bytes]:
    """Returns the folder's files by name."""
    return {
        "caterpillar.glb": _caterpillar(),
        "top.glb": _rigid({name: (part, _material(WOOD[name], 0.3, 0.9)) for name, part in top_parts().items()}),
        "block.glb": _rigid({"block": (block(), _material((0.8, 0.8, 0.8), 0.5, 0.0))}),
        "wood.jpg": _picture(_planks(np.random.default_rng(4)), "JPEG"),
        "caterpillar.yaml": text_of(scene(), COMMENT, Path(__file__).name, f"0-{FRAMES - 1}"),
    }


def _picture(pixels: np.ndarray, form: str) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, form, optimize=True, quality=84)
    return stream.getvalue()


def _material(color: tuple[float, ...], roughness: float, varnish: float) -> dict[str, Any]:
    pbr = {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0, "roughnessFactor": roughness}
    if not varnish:
        return {"pbrMetallicRoughness": pbr}
    coat = {"clearcoatFactor": varnish, "clearcoatRoughnessFactor": 0.08}
    return {"pbrMetallicRoughness": pbr, "extensions": {"KHR_materials_clearcoat": coat}}


def _mesh(file: Glb, parts: dict[str, tuple[Part, dict[str, Any]]]) -> int:
    """Adds a mesh with a primitive per material; returns its index."""
    primitives = []
    for name, (part, material) in parts.items():
        attributes = {"POSITION": file.accessor(part.positions, bounded=True), "NORMAL": file.accessor(part.normals)}
        if part.uvs is not None:
            attributes["TEXCOORD_0"] = file.accessor(part.uvs)
        if len(part.joints):
            shares = np.round(255 * part.weights)
            shares[:, 0] += 255 - shares.sum(1)
            attributes["JOINTS_0"] = file.accessor(part.joints, BYTE)
            attributes["WEIGHTS_0"] = file.accessor(shares, BYTE, normalized=True)
        indices = file.accessor(part.triangles.ravel(), SHORT)
        at = file.add("materials", {"name": name, **material})
        primitives.append({"attributes": attributes, "indices": indices, "material": at})
    if any("extensions" in material for _, material in parts.values()):
        file.document["extensionsUsed"] = ["KHR_materials_clearcoat"]
    return file.add("meshes", {"primitives": primitives})


def _rigid(parts: dict[str, tuple[Part, dict[str, Any]]]) -> bytes:
    file = Glb(GENERATOR)
    file.node(mesh=_mesh(file, parts))
    return file.data()


def _caterpillar() -> bytes:
    """Returns the skinned caterpillar with its bones and animation, as GLB."""
    file = Glb(GENERATOR)
    parts = {name: (part, _material(*TOY[name])) for name, part in body_parts().items()}
    parts["skin"][1]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": file.texture(_picture(skin_picture(), "PNG"))}
    nodes: list[int] = []
    for joint in JOINTS:
        origin = np.zeros(3) if joint.parent is None else JOINTS[joint.parent].place
        parent = None if joint.parent is None else nodes[joint.parent]
        nodes.append(file.node(parent, name=joint.name, translation=np.round(joint.place - origin, 6).tolist()))
    inverse = np.tile(np.eye(4), (len(JOINTS), 1, 1))
    inverse[:, 3, :3] = [-joint.place for joint in JOINTS]  # column-major, as in glTF
    skin = file.add("skins", {"joints": nodes, "inverseBindMatrices": file.accessor(inverse.reshape(-1, 16))})
    file.node(name="caterpillar", mesh=_mesh(file, parts), skin=skin)
    turns, place = bones(MOMENTS)
    tracks = {(node, "rotation"): turns[:, i] for i, node in enumerate(nodes)} | {(nodes[0], "translation"): place}
    file.animation("looks after the top", MOMENTS, tracks)
    return file.data()


def _keys(values: np.ndarray, digits: int = 4) -> dict[str, Any]:
    """Returns keyframes with a value for each frame."""
    return {"keys": [[round(t, 5), np.round(v, digits).tolist()] for t, v in zip(MOMENTS.tolist(), values, strict=True)]}


def scene() -> Scene:
    """Returns the content of caterpillar.yaml."""
    eye, target = camera(MOMENTS)
    front = {"name": "front", "eye": _keys(eye), "target": _keys(target), "fov": 30, "aperture": 0.05, "focus": [-0.2, 0.9, 0.5]}
    moon = [{"scale": 1.25}, {"translate": [1.25, 2.15, -9.4]}]
    return {
        "name": "Caterpillar and top",
        "fps": FPS,
        "settings": {"width": 640, "height": 360, "spp": 32, "max_depth": 7, "shutter": 0.5},
        "cameras": [front],
        "environment": {"color": [0.13, 0.15, 0.19]},
        "textures": {"planks": {"image": "wood.jpg"}},
        "materials": {
            "table": {"texture": "planks", "roughness": 0.4, "clearcoat": 0.35, "clearcoat_roughness": 0.15},
            "wall": {"color": [0.05, 0.22, 0.25]},
            "window": {"color": 0, "emission": [17, 13.5, 9.5]},
            "sky": {"color": 0, "emission": [2.2, 3.0, 4.2]},
            "rim": {"color": 0, "emission": [13, 9, 6]},
            "moon": {"color": [0.7, 0.45, 0.2], "emission": [1.15, 0.72, 0.3]},
            "mustard": _painted([0.75, 0.42, 0.04]),
            "coral": _painted([0.7, 0.11, 0.06]),
            "blue": _painted([0.04, 0.2, 0.42]),
            "mint": _painted([0.16, 0.5, 0.36]),
            "white": _painted([0.8, 0.74, 0.62]),
        },
        "shapes": [
            {"name": "wall", "type": "lathe", "material": "wall", "profile": [[11, -3], [11, 9]], "segments": 96},
            {"name": "table", "type": "quad", "material": "table", "transform": [{"scale": [11, 8, 1]}, _about("x", -90)]},
            {"name": "moon", "type": "disk", "material": "moon", "transform": moon},
            _lamp("window", (-5.2, 5.0, 4.2), (1.7, 1.9), 38, 128),
            _lamp("sky", (6.2, 4.0, 3.6), (2.4, 2.0), 22, -120),
            _lamp("rim", (3.2, 5.2, -5.2), (1.5, 0.9), 40, -32),
            {"name": "caterpillar", "type": "mesh", "file": "caterpillar.glb"},
            _top(),
            *_bricks(),
            *_rings(2.95, -2.5),
            sphere("ball", "coral", (-3.1, 0.42, -1.9), 0.42),
        ],
    }


def _painted(color: list[float]) -> dict[str, Any]:
    return {"color": color, "roughness": 0.45, "clearcoat": 0.5, "clearcoat_roughness": 0.1}


def _about(axis: str, degrees: Any) -> dict[str, Any]:
    return {"rotate": {"axis": axis, "degrees": degrees}}


def _lamp(material: str, at: tuple[float, ...], size: tuple[float, float], tilt: float, turn: float) -> Shape:
    """Returns a rectangular light; at tilt 90 it points straight down."""
    transform = [{"scale": [*size, 1]}, _about("x", tilt), _about("y", turn), {"translate": list(at)}]
    return {"name": material, "type": "quad", "material": material, "transform": transform}


def _top() -> Shape:
    """Returns the spinning top, a toy, as nested groups: one travels, one precesses, one spins."""
    turns = top_turns(MOMENTS)
    spin = [_about("y", _keys(turns["spin"] - turns["sway"], 2))]
    spins = {"name": "spins", "type": "mesh", "file": "top.glb", "transform": spin}
    leans = [_about("x", _keys(turns["lean"], 3)), _about("y", _keys(turns["sway"], 2))]
    return {
        "name": "top",
        "type": "group",
        "transform": [{"translate": _keys(top_place(MOMENTS))}],
        "shapes": [{"name": "leans", "type": "group", "transform": leans, "shapes": [spins]}],
    }


def _bricks() -> list[Shape]:
    """Returns toy building blocks in the background, in stacks of two."""
    found = []
    for i, (material, x, y, z, turn) in enumerate(BRICKS):
        transform = [{"scale": 0.55}, _about("y", turn), {"translate": [x, round(0.55 + 1.1 * y, 3), z]}]
        found.append({"name": f"block {i}", "type": "mesh", "file": "block.glb", "material": material, "transform": transform})
    return found


def _rings(x: float, z: float) -> list[Shape]:
    """Returns rings on a peg, the widest at the bottom."""
    found: list[Shape] = []
    height = 0.0
    for material, reach in (("blue", 0.8), ("mint", 0.68), ("mustard", 0.57), ("coral", 0.46)):
        thick = 0.17
        turn = np.linspace(-np.pi, np.pi, 25)
        profile = np.stack([reach - thick + thick * np.cos(turn), thick + thick * np.sin(turn)], -1).round(4).tolist()
        at = {"translate": [x, round(height, 3), z]}
        found.append(
            {
                "name": f"ring {material}",
                "type": "lathe",
                "material": material,
                "profile": profile,
                "segments": 72,
                "transform": [at],
            }
        )
        height += 1.9 * thick
    return [*found, sphere("knob", "white", (x, height + 0.2, z), 0.24)]


def _planks(random: np.random.Generator) -> np.ndarray:
    """Returns (512, 1024, 3) uint8: boards side by side, with horizontal grain."""
    height, width, boards = 512, 1024, 10

    def cloud(across: float, down: float) -> np.ndarray:
        """Returns noise of variance 1 with wavelengths of `across` and `down` pixels."""
        fx, fy = np.fft.rfftfreq(width), np.fft.fftfreq(height)[:, None]
        shape = np.exp(-0.5 * ((fx * across) ** 2 + (fy * down) ** 2))
        found = np.fft.irfft2(np.fft.rfft2(random.normal(size=(height, width))) * shape, (height, width))
        return np.asarray(found / found.std())

    y = np.arange(height)[:, None] * boards / height
    board = y.astype(int) + 0 * np.arange(width)
    shifted = np.stack([np.roll(row, 257 * (i * boards // height)) for i, row in enumerate(cloud(300, 14))])
    rings = np.sin(2 * np.pi * (2.2 * (y % 1) + 0.55 * shifted + random.uniform(0, 1, boards)[board]))
    tone = random.normal(size=boards)[board]
    light = 1 + 0.055 * rings + 0.05 * cloud(160, 2.5) + 0.03 * cloud(60, 1.2) + 0.09 * tone
    edge = np.minimum(y % 1, 1 - y % 1) * height / boards
    light = light * (1 - 0.55 * np.exp(-((edge / 1.1) ** 2)))
    color = np.array([0.60, 0.37, 0.20]) * light[..., None] ** np.array([1.0, 1.25, 1.6])
    return np.round(255 * color.clip(0, 1)).astype(np.uint8)


FOLDER = HERE / "caterpillar"


def main() -> None:
    """Writes the folder beside this script."""
    FOLDER.mkdir(exist_ok=True)
    for name, content in files().items():
        (FOLDER / name).write_bytes(content.encode() if isinstance(content, str) else content)


if __name__ == "__main__":
    main()
