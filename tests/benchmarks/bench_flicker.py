"""Flicker of denoised shots: frames denoised separately, and stabilised with their neighbours (renderer/temporal_denoise.py).

    python3 farm.py bench flicker [--size 192x108] [--shot "camera over texture"]

Error: root mean square of the difference from a reference, relative to the reference's mean. Flicker: root mean square, relative
to the same mean, of the change of that difference between consecutive frames along the motion vectors. Reference: many samples,
denoised. Measured with one seed for all frames, the default of a shot, and with a different seed for each.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from renderer import aovs
from renderer.denoise import denoise_with_guides
from renderer.film import ALBEDO, COLOR, NORMAL, mean
from renderer.frames import DENOISED_REACH
from renderer.render import render_frame
from renderer.scene.animation import BETWEEN, Moment
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Image, Instance, Material, SceneDescription, Sphere, Texture
from renderer.scene.shutter_merge import merge_over_shutter
from renderer.settings import RenderSettings, View
from renderer.temporal_denoise import DenoisedFrame, stabilised_frame
from renderer.vectors import motion_vectors
from tests.renderer.builders import gray, square

FRAMES = 3  # evaluated frames; DENOISED_REACH more are rendered on both sides
F32 = np.ndarray
Shot = Callable[[float], tuple[SceneDescription, View]]
FLOOR, RED, LAMP, MIRROR, WHITE = range(5)
STILL = View((0.0, 2.2, 5.5), (0.0, 0.4, 0.0), fov=40.0)


def stone(size: int = 256) -> np.ndarray:
    """Returns a texture with a 1/f spectrum and joints, (size, size, 4) uint8."""
    random = np.random.default_rng(1)
    far = np.fft.fftfreq(size)[:, None] ** 2 + np.fft.fftfreq(size)[None] ** 2
    grain = np.fft.ifft2(np.fft.fft2(random.standard_normal((size, size))) / np.sqrt(far + 1e-4)).real
    grain = 0.5 + 0.15 * grain / grain.std()
    joints = np.minimum(*(np.abs(np.mod(axis, size // 4) - size // 8) for axis in np.mgrid[0:size, 0:size])) < 2
    gray = np.clip(np.where(joints, 0.2, grain), 0.05, 0.95)
    return (np.stack([gray, 0.9 * gray, 0.75 * gray, np.ones_like(gray)], -1) * 255).astype(np.uint8)


def room() -> SceneDescription:
    """Returns a scene with a textured floor and wall, a ball and an upright board, under a lamp and a dim sky."""
    corners = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], np.float32)
    floor = replace(square((0, 0, 0), (8, 0, 0), (0, 0, -8), FLOOR), uvs=corners)
    wall = square((0, 2, -3), (8, 0, 0), (0, 2, 0), RED)
    board = square((1.6, 0.6, -0.6), (0.5, 0, 0.2), (0, 0.6, 0), RED)
    lamp = square((-1.5, 4, 1), (0.4, 0, 0), (0, 0, 0.4), LAMP)
    return SceneDescription(
        meshes=[floor, wall, board, lamp],
        instances=[Instance(k) for k in range(4)],
        spheres=[Sphere((-1.3, 0.6, -0.8), 0.6, RED, "left")],
        materials=[
            Material(base_color=gray(1.0), base_color_texture=0),
            Material(base_color=(0.7, 0.3, 0.2)),
            Material(base_color=gray(0.0), emission=gray(30.0), double_sided=True),
            Material(kind="conductor", roughness=0.1),
            Material(base_color=gray(0.8)),
        ],
        images=[Image("stone", stone())],
        textures=[Texture(0)],
        environment=Environment(gray(0.15)),
        moves=True,
    )


def indoors() -> SceneDescription:
    """Returns the same scene between walls, with a board below the lamp, so that all light is reflected by the ceiling."""
    found = room()
    more = [
        square((-1.5, 3.6, 1), (0.7, 0, 0), (0, 0, -0.7), RED),
        square((0, 5, 0), (8, 0, 0), (0, 0, 8), WHITE),
        square((-4, 2.5, 0), (0, 2.5, 0), (0, 0, 8), WHITE),
        square((4, 2.5, 0), (0, 0, 8), (0, 2.5, 0), WHITE),
        square((0, 2.5, 8), (8, 0, 0), (0, -2.5, 0), WHITE),
    ]
    found.instances += [Instance(len(found.meshes) + k) for k in range(len(more))]
    found.meshes += more
    found.environment = Environment(gray(0.0))
    return found


def static_camera(found: SceneDescription, t: float) -> View:
    """Returns the camera view at time t of a shot without motion."""
    return STILL


def moving_camera(found: SceneDescription, t: float) -> View:
    """Returns the view at time t of a camera that moves across the texture."""
    return replace(STILL, eye=(0.12 * t, 2.2, 5.5 - 0.05 * t), target=(0.08 * t, 0.4, 0.0))


def flying_ball(found: SceneDescription, t: float) -> View:
    """Adds a flying ball to the scene at its position at time t, and returns the view of the static camera."""
    found.spheres.append(Sphere((0.3 + 0.1 * t, 0.9, 0.6), 0.35, RED, "flies", moves=True))
    return STILL


def rotating_board(found: SceneDescription, t: float) -> View:
    """Adds a rotating board to the scene at its angle at time t, and returns the view of the static camera."""
    turned = np.eye(4)
    sine, cosine = math.sin(0.12 * t), math.cos(0.12 * t)
    turned[0, 0] = turned[2, 2] = cosine
    turned[0, 2], turned[2, 0], turned[:3, 3] = sine, -sine, (0.4, 0.7, 0.8)
    found.meshes.append(square((0, 0, 0), (0.6, 0, 0), (0, 0.6, 0), RED))
    found.instances.append(Instance(len(found.meshes) - 1, turned, moves=True))
    return STILL


def passing_mirror(found: SceneDescription, t: float) -> View:
    """Adds a mirror ball to the scene, and returns the view at time t of a camera that moves past the ball."""
    found.spheres.append(Sphere((0.4, 0.7, 0.8), 0.7, MIRROR, "mirror"))
    return moving_camera(found, t)


MOVES: dict[str, Callable[[SceneDescription, float], View]] = {
    "nothing moves": static_camera,
    "camera over texture": moving_camera,
    "body and its shadow": flying_ball,
    "board that turns": rotating_board,
    "camera past a mirror": passing_mirror,
}
LIGHTS = {
    "a lamp": (room, 8, 256),
    "by the ceiling": (indoors, 16, 400),
}  # name -> (scene, samples per pixel, samples of the reference)


def shot_of(place: Callable[[], SceneDescription], move: Callable[[SceneDescription, float], View]) -> Shot:
    """Returns a shot: a function of time that calls `place` for a new scene, and applies `move` to the scene at that time."""

    def at(t: float) -> tuple[SceneDescription, View]:
        found = place()
        return found, move(found, t)

    return at


def still(shot: Shot, frame: int, spp: int, seed: int, size: tuple[int, int]) -> DenoisedFrame:
    """Renders one frame of the shot and denoises it by itself; returns it with the layers that temporal denoising needs."""
    description, view = shot(frame)
    settings = RenderSettings(*size, view, seed=seed)
    sums = render_frame(compile_scene(description), settings, spp)
    exponent = settings.film_exponent
    over = merge_over_shutter(lambda moment: shot(frame + moment.offset)[0], Moment(), BETWEEN)
    views = tuple(shot(frame + k)[1] for k in (-1, 0, 1))
    moving = replace(settings, views=views if len({*views}) > 1 else ())
    return DenoisedFrame(
        denoise_with_guides(mean(sums, exponent, COLOR), mean(sums, exponent, ALBEDO), mean(sums, exponent, NORMAL)),
        aovs.values(sums, exponent, "object"),
        aovs.values(sums, exponent, "material"),
        motion_vectors(compile_scene(over), moving),
    )


def _tone_mapped(light: F32) -> F32:
    """Returns radiance compressed to x / (1 + x), so that a lamp seen in a mirror does not dominate the error."""
    return light / (1 + light)


def error_change_along_motion(first: F32, second: F32, there: DenoisedFrame) -> tuple[F32, np.ndarray]:
    """Returns how the error changes from one frame to the next along the motion vectors, and a mask (h, w) of defined pixels.

    first, second: errors of the two frames. there: the second frame's auxiliary layers. Pixels whose motion vector leads outside
    the first frame are not defined.
    """
    height, width = first.shape[:2]
    rows, columns = np.mgrid[0:height, 0:width]
    y = np.rint(rows - there.motion[..., 1]).astype(int)
    x = np.rint(columns + there.motion[..., 0]).astype(int)
    inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
    y, x = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
    return second - first[y, x], inside


def figures(made: dict[int, F32], truth: dict[int, DenoisedFrame]) -> tuple[float, float]:
    """Compares frames with reference frames, and returns (error, flicker), as bench_flicker's module docstring defines them.

    made: radiance by frame number. truth: reference frames by the same numbers.
    """
    whole = float(np.mean([each.clean.color.mean() for each in truth.values()]))
    off = {n: _tone_mapped(picture / whole) - _tone_mapped(truth[n].clean.color / whole) for n, picture in made.items()}
    level = float(np.mean([_tone_mapped(each.clean.color / whole).mean() for each in truth.values()]))
    error = math.sqrt(np.mean([(each**2).mean() for each in off.values()])) / level
    changes = []
    for n in sorted(off)[1:]:
        change, inside = error_change_along_motion(off[n - 1], off[n], truth[n])
        changes.append((change[inside] ** 2).mean())
    return error, math.sqrt(np.mean(changes)) / level


def main() -> int:
    """Prints the table of errors and flicker."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--size", default="192x108")
    parser.add_argument("--shot", choices=list(MOVES), default=None)
    options = parser.parse_args()
    width, height = (int(part) for part in options.size.split("x"))
    print(f"{width}x{height}, per cent of the mean; of each the frame by itself, then made steady")
    print("| shot | light | seeds | error | steady | flicker | steady |")
    print("|---|---|---|---:|---:|---:|---:|")
    numbers, whole = range(DENOISED_REACH, DENOISED_REACH + FRAMES), range(FRAMES + 2 * DENOISED_REACH)
    for light, (place, spp, most) in LIGHTS.items():
        for name, move in MOVES.items():
            if options.shot not in (None, name):
                continue
            shot = shot_of(place, move)
            truth = {n: still(shot, n, most, 1000 + n, (width, height)) for n in numbers}
            for seeds in ("one", "each"):
                frames = {n: still(shot, n, spp, n if seeds == "each" else 0, (width, height)) for n in whole}
                alone = figures({n: frames[n].clean.color for n in numbers}, truth)
                steady = figures({n: stabilised_frame(frames, n) for n in numbers}, truth)
                row = " | ".join(f"{100 * value:.2f}" for value in (alone[0], steady[0], alone[1], steady[1]))
                print(f"| {name} | {light} | {seeds} | {row} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
