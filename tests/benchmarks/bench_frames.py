"""Cost of a shot's frame beyond rendering: seconds of one core, and bytes stored and sent.

    python -m tests.benchmarks.bench_frames [STATIC TRIANGLES] [FRAMES] [SHOT ...]

Four shots: a moving camera, 100 rigid bodies, a skinned figure of 50,000 vertices, and a morph of a million triangles, each in a
static set of five million triangles. The scenes are generated. Times are processor seconds with one thread; the first frame,
which builds the set, is listed separately.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rayfarm.stage import OpenScene
from renderer.scene.animation import Moment
from renderer.scene.compiled import load
from renderer.scene.compiled_parts import Saver, parts_of
from renderer.scene.load import Shot
from tests.renderer.scene.builders import Gltf, clip

SET = 5_000_000
PIECES = 500  # meshes in the static set
FRAMES = 24


def relief(triangles: int, seed: float, size: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns (positions, normals, triangle indices) of a hilly square with that many triangles."""
    n = int((triangles / 2) ** 0.5) + 1
    v, u = np.mgrid[0:n, 0:n] / (n - 1)
    height = 0.05 * np.sin(9 * u + seed) * np.cos(7 * v - seed)
    slope_u, slope_v = 0.45 * np.cos(9 * u + seed) * np.cos(7 * v - seed), -0.35 * np.sin(9 * u + seed) * np.sin(7 * v - seed)
    position = np.stack([size * u, size * height, size * v], -1).reshape(-1, 3).astype(np.float32)
    normal = np.stack([-slope_u, np.ones_like(u), -slope_v], -1).reshape(-1, 3)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1)
    lower, upper = np.stack([corner, corner + n, corner + 1], -1), np.stack([corner + 1, corner + n, corner + n + 1], -1)
    return position, normal.astype(np.float32), np.stack([lower, upper], 1).reshape(-1).astype(np.uint32)


def tube(vertices: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns (positions, normals, triangle indices) of a tube around the y axis, 4 units high and open at both ends."""
    around = 100
    rows = vertices // around
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(turn), np.zeros(around), np.sin(turn)], -1)
    rise = np.linspace(0, 4, rows)[:, None, None] * np.array([0, 1, 0])
    position = (0.5 * ring + rise).reshape(-1, 3).astype(np.float32)
    a = np.arange(rows - 1)[:, None] * around + np.arange(around)
    b = np.arange(rows - 1)[:, None] * around + (np.arange(around) + 1) % around
    faces = np.stack([a, a + around, b, b, a + around, b + around], -1)
    return position, np.tile(ring, (rows, 1)).astype(np.float32), faces.reshape(-1).astype(np.uint32)


def still_set(triangles: int) -> Gltf:
    """Returns the part of the scene that all shots share: a camera, and a static ground of several meshes.

    Each mesh has a node of its own.
    """
    g = Gltf()
    side = int(np.ceil(PIECES**0.5))
    for i in range(PIECES):
        position, normal, index = relief(triangles // PIECES, i)
        g.mesh(position, index, NORMAL=normal)
        g.root["nodes"][-1] |= {"translation": [float(i % side), 0.0, float(i // side)], "name": f"ground {i}"}
    g.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
    g.node(camera=0, translation=[10, 3, 30], name="camera")
    return g


def turns(count: int, offset: float = 0.0) -> np.ndarray:
    """Returns `count` keyframe values of a rotation about y, as quaternions (x, y, z, w).

    offset: initial half angle in radians.
    """
    half = np.linspace(0, np.pi, count) + offset
    return np.stack([0 * half, np.sin(half), 0 * half, np.cos(half)], -1)


def camera_move(g: Gltf) -> Gltf:
    """Adds the animation of shot (a) to the static scene: a moving camera."""
    return clip(g, "fly", (len(g.root["nodes"]) - 1, "translation", [0, 1], [(10, 3, 30), (12, 4, 20)], "LINEAR"))


def rigid_bodies(g: Gltf) -> Gltf:
    """Adds the bodies of shot (b) to the static scene: 100 bodies, each on a rotating arm, with ten meshes of 2,000 triangles.

    Every second body also rotates about its own axis.
    """
    channels = []
    for i in range(100):
        if i < 10:
            position, normal, index = relief(2000, i)
            g.mesh(position, index, NORMAL=normal)
        mesh = PIECES + i % 10
        if i < 10:
            g.root["nodes"].pop()
            g.root["scenes"][0]["nodes"].pop()
        number = len(g.root["nodes"])
        g.node(children=[number + 1], translation=[float(i % 10) * 2, 1.0, float(i // 10) * 2])
        g.node(top=False, mesh=mesh, translation=[0.5, 0, 0], name=f"body {i}")
        channels.append((number, "rotation", [0, 1, 2], turns(3, i), "LINEAR"))
        if i % 2:
            channels.append((number + 1, "rotation", [0, 1, 2], turns(3, 2 * i), "LINEAR"))
    return clip(g, "dance", *channels)


def figure(g: Gltf) -> Gltf:
    """Adds the figure of shot (c) to the static scene: 50,000 vertices, each bound to two of 60 rotating joints."""
    position, normal, index = tube(50_000)
    along = position[:, 1] / 4 * 58.999
    joint = np.stack([along, along + 1, 0 * along, 0 * along], -1).astype(np.uint8)
    share = (along % 1).astype(np.float32)
    weight = np.stack([1 - share, share, 0 * share, 0 * share], -1).astype(np.float32)
    g.mesh(position, index, NORMAL=normal, JOINTS_0=joint, WEIGHTS_0=weight)
    g.root["nodes"][-1] |= {"skin": 0, "name": "figure"}
    first = len(g.root["nodes"])
    bind = []
    for k in range(60):
        below = {"children": [first + k + 1]} if k < 59 else {}
        g.node(top=k == 0, translation=[10.0 if k == 0 else 0.0, 4 / 60 if k else 1.0, 10.0 if k == 0 else 0.0], **below)
        bind.append(np.array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -k * 4 / 60, 0, 1], np.float32))
    g.root["skins"] = [{"joints": list(range(first, first + 60)), "inverseBindMatrices": g.array(np.stack(bind))}]
    wave = [[(np.sin(a), 0, 0, np.cos(a)) for a in (0.0, 0.02 * np.sin(k), 0.0)] for k in range(60)]
    return clip(g, "walk", *((first + k, "rotation", [0, 1, 2], wave[k], "LINEAR") for k in range(60)))


def morph(g: Gltf) -> Gltf:
    """Adds the mesh of shot (d) to the static scene: a million triangles with one morph target."""
    position, normal, index = relief(1_000_000, 3.0, 10.0)
    other, bent, _ = relief(1_000_000, 5.0, 10.0)
    g.mesh(position + np.float32([5, 1, 5]), index, NORMAL=normal)
    target = {"POSITION": g.array(other - position), "NORMAL": g.array(bent - normal)}
    g.root["meshes"][-1]["primitives"][0]["targets"] = [target]
    return clip(g, "wave", (len(g.root["nodes"]) - 1, "weights", [0, 1, 2], [0, 1, 0], "LINEAR"))


SHOTS: dict[str, tuple[Callable[[Gltf], Gltf], float, str]] = {
    "camera": (camera_move, 0.005, "a camera moves"),
    "bodies": (rigid_bodies, 0.015, "100 rigid bodies"),
    "figure": (figure, 0.060, "a skinned figure of 50 k vertices"),
    "morph": (morph, 1.0, "a morph of 1 M triangles"),
}


class Cost(NamedTuple):
    """Cost of one frame.

    The seconds are processor time: to compile the scene, to write its new parts to files, and to map the parts in a slot. `bytes`
    is the size of the new parts and of the list of all parts.
    """

    compiled: float
    written: float
    mapped: float
    bytes: int


def costs(folder: Path, frames: int) -> list[Cost]:
    """Returns the cost of each frame of folder/shot.glb."""
    stage, out = OpenScene(Shot(folder, "shot.glb"), threads=1), folder / "parts"
    out.mkdir()
    saver, shown, known = Saver(out), None, set[str]()
    found = []
    for frame in range(frames + 1):
        begun = time.process_time()
        compiled, _ = stage.scene_at(Moment(frame))
        is_compiled = time.process_time()
        is_written = is_mapped = is_compiled
        size = 0
        if compiled is not shown:
            assert stage._kept is not None
            assert stage._kept.cuts is not None
            manifest = saver.save(compiled, stage._kept.cuts)
            is_written = time.process_time()
            load(manifest)
            is_mapped = time.process_time()
            new = [part for part in parts_of(manifest) if part.sha256 not in known]
            size = sum(part.size for part in new) + manifest.stat().st_size
            known |= {part.sha256 for part in new}
            if frame:
                for part in new:  # as after sending: only unchanged parts stay on disk
                    (out / part.sha256).unlink()
        shown = compiled
        found.append(Cost(is_compiled - begun, is_written - is_compiled, is_mapped - is_written, size))
    return found


def measure(name: str, triangles: int, frames: int) -> str:
    """Returns the table row of one shot, whose static set has that many triangles."""
    make, asked, words = SHOTS[name]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "shot.glb").write_bytes(make(still_set(triangles)).glb())
        first, *rest = costs(Path(folder), frames)
    median = Cost(*(float(np.median([getattr(cost, column) for cost in rest])) for column in Cost._fields))
    whole = [sum(cost[:3]) for cost in rest]
    columns = [f"{1000 * seconds:6.1f}" for seconds in median[:3]]
    asked_ms, found_ms, most_ms = (f"{1000 * seconds:6.1f}" for seconds in (asked, float(np.median(whole)), max(whole)))
    sizes = f"{median.bytes / 1e6:6.2f} MB | {first.bytes / 1e6:4.0f} MB"
    return f"| {words:33} | {' | '.join(columns)} | {found_ms} | {most_ms} | {asked_ms} | {sizes} |"


def main() -> None:
    """Prints the table of costs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("triangles", nargs="?", type=int, default=SET, help=f"of the set that stands still; {SET}")
    parser.add_argument("frames", nargs="?", type=int, default=FRAMES, help=f"after the first; {FRAMES}")
    parser.add_argument("shots", nargs="*", metavar="shot", help=f"of {', '.join(SHOTS)}; all unless told")
    given = parser.parse_args()
    if unknown := [name for name in given.shots if name not in SHOTS]:
        parser.error(f"there is no shot {', '.join(unknown)}; known are {', '.join(SHOTS)}")
    columns = ("ms a frame, one core", "compile", "write", "map", "in all", "most", "asked", "bytes a frame", "bytes once")
    print("| " + " | ".join(columns) + " |")
    print("|" + "---|" * len(columns), flush=True)
    for name in given.shots or SHOTS:
        print(measure(name, given.triangles, given.frames), flush=True)


if __name__ == "__main__":
    main()
