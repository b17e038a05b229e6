"""Evaluates assimp's animations: the transform of each node at a moment."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.animation import Clip, Curve, Moment
from renderer.scene.animation.moment import ALL_CLIPS
from renderer.scene.matrices import product
from renderer.scene.readers.assimp.library import Animation, Channel, Imported
from renderer.scene.readers.name_lookup import number_of

__all__ = ["Movement"]

F64 = npt.NDArray[np.float64]


class Movement:
    """The world transforms of a file's nodes at a moment, the clips, and the indices of the animated nodes."""

    def __init__(self, imported: Imported, moment: Moment, fps: float, file: str) -> None:
        animations = imported.animations
        self.clips = [Clip(a.name, 0.0, a.seconds) for a in animations]
        played: list[Animation] = animations[:1]
        if moment.clip is not None:
            together = moment.clip == ALL_CLIPS and bool(animations)
            played = animations if together else [animations[number_of("clip", [c.name for c in self.clips], moment.clip, file)]]
        self._channels = {channel.node: channel for animation in played for channel in animation.channels}
        self.others = sum(animation.others for animation in played)
        self.moving: set[int] = set()
        self.worlds: list[F64] = []
        self._seconds = moment.seconds(fps)
        for i, node in enumerate(imported.nodes):
            channel = self._channels.get(node.name)
            local = node.local if channel is None else self._local(channel, node.local)
            if (channel is not None and _is_animated(channel)) or node.parent in self.moving:
                self.moving.add(i)
            self.worlds.append(local if node.parent < 0 else product(self.worlds[node.parent][None], local[None])[0])

    def _local(self, channel: Channel, own: F64) -> F64:
        place, turn, scale = _decompose(own)
        if len(channel.places[0]):
            place = Curve(*_sorted_keys(*channel.places)).values_at(self._seconds)
        if len(channel.turns[0]):
            turn = _matrix(Curve(*_sorted_keys(*channel.turns), is_rotation=True).values_at(self._seconds))
        if len(channel.scales[0]):
            scale = Curve(*_sorted_keys(*channel.scales)).values_at(self._seconds)
        found = np.eye(4)
        found[:3, :3] = turn * np.array(scale)
        found[:3, 3] = place
        return found


def _sorted_keys(times: F64, values: F64) -> tuple[F64, F64]:
    """Returns an animation's keys, sorted by time."""
    order = np.argsort(times, kind="stable")
    return times[order], values[order]


def _is_animated(channel: Channel) -> bool:
    return any(
        len(values) > 1 and bool((values != values[0]).any()) for _, values in (channel.places, channel.turns, channel.scales)
    )


def _decompose(matrix: F64) -> tuple[list[float], F64, list[float]]:
    """Returns the translation, rotation and scale of a matrix; a reflection becomes a negative x scale."""
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        scale[0] = -scale[0]
    turn = np.divide(matrix[:3, :3], scale, out=np.eye(3), where=scale != 0)
    return matrix[:3, 3].tolist(), turn, scale.tolist()


def _matrix(quaternion: list[float]) -> F64:
    """Returns the rotation matrix of a quaternion x y z w of any length."""
    x, y, z, w = quaternion
    square = ((x * x + y * y) + z * z) + w * w
    s = 2.0 / square if square > 0 else 0.0
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )
