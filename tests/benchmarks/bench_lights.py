"""Choice of one light among many: by the light tree, by power, and uniformly.

    python -m tests.benchmarks.bench_lights [--counts 2,4,8,16,1000] [--size 96] [--spp 16]

The scene is a furnished room with emitters of all kinds (spheres, squares, points, spots) whose powers differ by a factor of
1,000. For each choice: mean squared error at equal samples, time, and mean squared error at equal time, relative to the tree's,
over the pixels that show no emitter. The reference uses the tree and 64 times as many samples. Times are processor seconds of one
thread, the minimum of three runs.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from renderer.arrays.scene import CompiledScene
from renderer.film import mean
from renderer.render import render_frame
from renderer.scene import lights as light_lists
from renderer.scene.compile import compile_scene
from renderer.scene.description import Instance, Light, Material, Mesh, SceneDescription, Sphere
from renderer.settings import LIGHT_CHOICES, RenderSettings, View

_ROOM = np.array([20.0, 5.0, 20.0])


def _square(center: np.ndarray, u: np.ndarray, v: np.ndarray, material: int) -> Mesh:
    corners = np.array([center - u - v, center + u - v, center + u + v, center - u + v], np.float32)
    return Mesh("square", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), material=material)


def room(count: int, seed: int = 0) -> CompiledScene:
    """Returns a room of 40 x 10 x 40 with 60 balls and `count` lights (a square counts as two) distributed over it."""
    rng = np.random.default_rng(seed)
    materials = [Material(base_color=(0.7, 0.7, 0.7)), Material(kind="metallic_roughness", roughness=0.4)]
    sides = [(axis, sign) for axis in range(3) for sign in (-1, 1)]
    meshes = []
    for axis, sign in sides:  # walls face inwards
        u, v = np.eye(3)[(axis + 1) % 3] * _ROOM, -sign * np.eye(3)[(axis + 2) % 3] * _ROOM
        meshes.append(_square(sign * np.eye(3)[axis] * _ROOM, u, v, 0))
    spheres = [Sphere(tuple(rng.uniform(-0.9, 0.9, 3) * _ROOM), rng.uniform(0.3, 1.0), int(i % 2)) for i in range(60)]
    lights = []
    made = 0
    while made < count:
        place = rng.uniform(-0.95, 0.95, 3) * _ROOM
        power = 10 ** rng.uniform(-1.5, 1.5)
        kind = rng.integers(0, 4) if made < count - 1 else 2
        if kind == 0:
            radius = rng.uniform(0.02, 0.15)
            materials.append(Material(base_color=(0, 0, 0), emission=(power / (4 * np.pi**2 * radius**2),) * 3))
            spheres.append(Sphere(tuple(place), radius, len(materials) - 1))
        elif kind == 1:
            u, v = rng.normal(0, 0.15, (2, 3))
            area = 4 * np.linalg.norm(np.cross(u, v))
            materials.append(Material(base_color=(0, 0, 0), emission=(power / (np.pi * area),) * 3))
            meshes.append(_square(place, u, v, len(materials) - 1))
            made += 1
        elif kind == 2:
            lights.append(Light("point", (power / (4 * np.pi),) * 3, tuple(place), radius=0.05))
        else:
            axis = rng.normal(size=3) + np.array([0, -1.5, 0])
            lights.append(Light("spot", (power / np.pi,) * 3, tuple(place), tuple(axis), outer_cone=rng.uniform(20, 60)))
        made += 1
    description = SceneDescription(
        meshes=meshes, instances=[Instance(i) for i in range(len(meshes))], spheres=spheres, materials=materials, lights=lights
    )
    light_lists.TREE_FROM = 1
    return compile_scene(description)


def _timed(scene: CompiledScene, settings: RenderSettings, spp: int) -> tuple[np.ndarray, float]:
    started = time.process_time()
    sums = render_frame(scene, settings, spp, threads=1)
    return mean(sums, settings.film_exponent), time.process_time() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", default="2,4,8,16,64,1000")
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--depth", type=int, default=2)
    given = parser.parse_args()
    view = View((-18.0, 3.0, -18.0), (0.0, -1.0, 0.0), fov=70)
    print("relative to the tree's: mean squared error at equal samples, time, and mean squared error at equal time")
    for count in (int(c) for c in given.counts.split(",")):
        tree = room(count)
        settings = RenderSettings(given.size, given.size, view, max_depth=given.depth, seed=1)
        ways = {choice: replace(settings, light_choice=choice) for choice in LIGHT_CHOICES}
        reference = mean(render_frame(tree, replace(settings, seed=0), given.spp * 64), 24)
        shaded = mean(render_frame(tree, replace(settings, max_depth=1), 256), 24).max(axis=2) == 0
        first: tuple[float, float] | None = None
        for name, asked in ways.items():
            runs = [_timed(tree, asked, given.spp) for _ in range(3)]
            error = float(np.square(runs[0][0] - reference)[shaded].mean())
            seconds = min(run[1] for run in runs)
            first = first or (error, seconds)
            worse, slower = error / first[0], seconds / first[1]
            print(f"{count:6d} lights  {name:8s} {worse:8.2f} {slower:6.2f} {worse * slower:8.2f}")


if __name__ == "__main__":
    main()
