"""Animation of the folder caterpillar/: a loop of four seconds.

The top circles the caterpillar, which follows it with its head as far as its neck turns, and then waits on the other side.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from caterpillar_meshes import HEAD_RADIUS, JOINTS, LENGTH, SPINE, _radius

__all__ = ["FPS", "FRAMES", "bones", "camera", "top_place", "top_turns"]

FPS, FRAMES = 24, 96
PERIOD = FRAMES / FPS  # seconds
CENTER, REACH = np.array([0.05, 0.0, 0.1]), np.array([2.05, 0.0, 1.55])
BEGIN = np.radians(38)  # phase of the top's path at the start: on the right, approaching
TAIL = np.array([1.05, 0.0, -0.95])


def _phase(t: np.ndarray) -> np.ndarray:
    return 2 * np.pi * np.asarray(t, float) / PERIOD


def _smooth(s: np.ndarray, low: float, high: float) -> np.ndarray:
    s = ((s - low) / (high - low)).clip(0, 1)
    return s * s * (3 - 2 * s)


def top_place(t: np.ndarray) -> np.ndarray:
    """Returns the position of the spinning top's tip at the times `t`, (k, 3).

    It moves from right to left in front of the caterpillar, and back behind it.
    """
    angle = BEGIN + _phase(t)
    round_it = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], -1)
    wobble = 0.06 * np.stack([np.cos(5 * angle), 0 * angle, np.sin(5 * angle)], -1)
    return CENTER + REACH * round_it + wobble


def top_turns(t: np.ndarray) -> dict[str, np.ndarray]:
    """Returns the spinning top's angles at the times `t`, in degrees, (k,) each: spin, lean, and direction of the lean."""
    phase = _phase(t)
    return {"spin": np.degrees(20 * phase), "lean": 9 + 3 * np.sin(2 * phase), "sway": np.degrees(5 * phase)}


def camera(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the camera's eye and target at the times `t`, (k, 3) each. Both drift with the spinning top and back."""
    phase = _phase(t) + BEGIN
    eye = np.stack([0.35 + 1.15 * np.cos(phase - 0.5), 2.15 + 0.22 * np.sin(phase + 2.4), 6.6 - 0.45 * np.sin(phase - 0.3)], -1)
    target = np.stack([0.06 + 0.1 * np.cos(phase - 0.4), 0.98 + 0 * phase, 0.0 * phase], -1)
    return eye, target


@cache
def _gaze() -> tuple[np.ndarray, np.ndarray]:
    """Returns, at fine time steps, the face's yaw in radians, positive to the right, and how puzzled it looks, 0..1."""
    t = np.arange(4 * FRAMES) / (4 * FPS)
    place = top_place(t) - [-0.45, 0.0, 0.35]
    angle = np.arctan2(place[:, 0], place[:, 2])
    wanted = angle.clip(-1.55, 1.6)
    # It cannot see behind its back: it pauses, turns around quickly, and waits.
    way = (np.degrees(BEGIN + _phase(t)) % 360).round(6)
    lost = (way > 208) & (way < 340)
    wanted = np.where(lost, -1.55 + 3.15 * _smooth(way, 238, 290), wanted)
    puzzled = _smooth(way, 205, 228) * (1 - _smooth(way, 250, 282))

    def soft(values: np.ndarray, width: float, late: float) -> np.ndarray:
        around = np.fft.rfftfreq(len(t), 1 / (4 * FPS))
        filtered = np.exp(-0.5 * (2 * np.pi * around * width) ** 2 - 2j * np.pi * around * late)
        return np.fft.irfft(np.fft.rfft(values) * filtered, len(t))

    return soft(wanted, 0.07, 0.09), soft(puzzled, 0.05, 0.05)


def _at(values: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.interp(np.asarray(t) % PERIOD, np.arange(len(values) + 1) / (4 * FPS), np.append(values, values[0]))


def _turn(axis: int, angle: np.ndarray) -> np.ndarray:
    """Returns quaternions (..., 4), x y z w, of rotations about an axis."""
    found = np.zeros((*np.shape(angle), 4))
    found[..., axis], found[..., 3] = np.sin(np.asarray(angle) / 2), np.cos(np.asarray(angle) / 2)
    return found


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    ax, ay, az, aw = np.moveaxis(a, -1, 0)
    bx, by, bz, bw = np.moveaxis(b, -1, 0)
    x, y = aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx
    z, w = aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz
    return np.stack([x, y, z, w], -1)


def _back(a: np.ndarray) -> np.ndarray:
    return a * np.array([-1.0, -1.0, -1.0, 1.0])


def _rotated(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    pure = np.concatenate([vector, np.zeros((*vector.shape[:-1], 1))], -1)
    return _times(_times(q, pure), _back(q))[..., :3]


def _spine(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns world rotations of the spine's bones (k, SPINE, 4), and the tail's position (k, 3)."""
    s = (np.arange(SPINE) + 0.5) / SPINE
    phase = _phase(t)[:, None]
    gaze = _at(_gaze()[0], t)[:, None]
    puzzled = _at(_gaze()[1], t)[:, None]
    # The spine bends left and then forward on the ground; a wave runs along the back, and the tail wags.
    wave = 0.2 * np.sin(2 * np.pi * 3.2 * s - 4 * phase) * (1 - _smooth(s, 0.3, 0.5))
    tail = (1 - _smooth(s, 0.0, 0.2)) * (-0.55 + 0.25 * np.sin(4 * phase))
    rise = 1.38 * _smooth(s, 0.42, 0.68) - 0.85 * _smooth(s, 0.74, 1.0) * (1 - 0.5 * puzzled)
    lean = 0.1 * np.sin(2 * phase) * _smooth(s, 0.4, 0.7) + 0.1 * np.abs(gaze) * _smooth(s, 0.5, 0.8)
    pitch = wave + tail + rise + lean
    yaw = np.pi + 0.5 * np.pi * _smooth(s, 0.08, 0.52) + 0.5 * np.sin(4 * phase + 0.8) * (1 - _smooth(s, 0.0, 0.22))
    yaw = yaw + 0.78 * gaze * _smooth(s, 0.48, 1.0)
    world = _times(_turn(1, yaw), _turn(2, pitch))
    # Moved vertically so that the lowest point touches the table.
    step = LENGTH / SPINE * _rotated(world, np.broadcast_to([1.0, 0, 0], (*world.shape[:-1], 3)))
    middles = np.cumsum(step, 1) - step / 2
    lowest = (middles[..., 1] - _radius(s) - 0.03).min(1)
    place = TAIL + np.stack([0 * lowest, -lowest, 0 * lowest], -1)
    return world, place


def bones(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the bones' local rotations (k, joints, 4), and the first bone's position (k, 3)."""
    t = np.asarray(t, float)
    number = {joint.name: i for i, joint in enumerate(JOINTS)}
    spine, place = _spine(t)
    local = np.tile([0.0, 0, 0, 1], (len(t), len(JOINTS), 1))
    local[:, 0] = spine[:, 0]
    local[:, 1:SPINE] = _times(_back(spine[:, :-1]), spine[:, 1:])

    # The face looks at the top; the head tilts when it has lost sight of it.
    bone = LENGTH / SPINE * np.array([1.0, 0, 0])
    tip = place + _rotated(spine, np.broadcast_to(bone, (*spine.shape[:-1], 3))).sum(1)
    gaze, puzzled = _at(_gaze()[0], t), _at(_gaze()[1], t)
    sight = top_place(t) + np.array([0, 0.45, 0]) - tip
    down = np.arctan2(sight[:, 1] - 0.25, np.hypot(sight[:, 0], sight[:, 2])) * (1 - 0.75 * puzzled)
    roll = 0.16 * np.sin(2 * _phase(t) + 0.6) + 0.42 * puzzled
    head = _times(_times(_turn(1, 1.5 * np.pi + gaze), _turn(2, 0.75 * down)), _turn(0, roll))
    local[:, SPINE] = _times(_back(spine[:, -1]), head)

    # The eyes move faster than the head, by small angles.
    seen = _rotated(_back(head), sight)
    aside = np.arctan2(-seen[:, 2], seen[:, 0].clip(0.05)).clip(-0.42, 0.42) * (1 - puzzled)
    upward = np.arctan2(seen[:, 1] - HEAD_RADIUS / 3, np.hypot(seen[:, 0], seen[:, 2])).clip(-0.3, 0.3)
    blink = np.exp(-(((t - _blinks()[:, None]) / 0.055) ** 2)).sum(0).clip(0, 1)
    swing = np.gradient(_at(_gaze()[0], np.stack([t - 0.06, t, t + 0.06])), 0.06, axis=0)[1]
    for side, z in (("left", -1.0), ("right", 1.0)):
        local[:, number[f"{side} eye"]] = _times(_turn(1, aside), _turn(2, upward))
        local[:, number[f"{side} lid"]] = _turn(2, 0.1 - 1.6 * blink)
        # The antennae lag behind the head's rotation, and swing.
        bob = 0.14 * np.sin(6 * _phase(t) + z)
        local[:, number[f"{side} antenna"]] = _times(_turn(0, -0.06 * swing), _turn(2, 0.5 * bob))
        local[:, number[f"{side} antenna's tip"]] = _times(_turn(0, -0.1 * swing), _turn(2, bob))
    return local, place


def _blinks() -> np.ndarray:
    """Returns the times of the caterpillar's two blinks, in seconds: when it turns around, and 1.9 s before."""
    turning = (np.radians(262) - BEGIN) / (2 * np.pi) * PERIOD
    return np.array([turning, turning - 1.9])
