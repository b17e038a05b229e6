"""Pictures of contestants in a given processor time, and converged references; both are kept in a folder and never made twice."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from renderer.image.read import read as read_image
from renderer.jit import kind
from tests.benchmarks.hard.contestants import ON, Contestant
from tests.benchmarks.hard.scenes import SCENES, SIZE
from tests.benchmarks.peers.asking import Peer

__all__ = ["Reference", "Render", "Renderer", "kept_render", "opened", "reference_of", "seed_of", "store_render"]

_FIRST_SEED = 1
_REFERENCE_SEED = 100_000
_CALIBRATION_SEED = 90_000
_ENOUGH = 0.25  # of the asked time, for a calibration
_MOST_SAMPLES = 1 << 16
_PART_SECONDS = 15.0  # of a reference
_NEARLY = 0.9  # of the asked time suffices, since parts take only about as long as is asked
_HERE = Path(__file__).parent
# What pictures depend on, besides a scene: the programs and what they import from this package.
_PROGRAMS = {
    "rayfarm_peer": ("rayfarm_peer.py", "rayfarm_files.py"),
    "mitsuba_peer": ("mitsuba_peer.py", "rayfarm_files.py"),
    "blender_peer": ("blender_peer.py", "blender_scene.py"),
    "luxcore_peer": ("luxcore_peer.py", "luxcore_scene.py"),
}


@dataclass(frozen=True)
class Render:
    """A picture (SIZE, SIZE, 3), the processor seconds that it took without start-up, and its samples per pixel."""

    picture: np.ndarray
    seconds: float
    samples: int
    version: str


@dataclass(frozen=True)
class Reference:
    """A converged picture of a scene, and the pictures of its two halves, of equal numbers of parts.

    kind: of the renderer that made it. seconds: processor time.
    """

    picture: np.ndarray
    halves: tuple[np.ndarray, np.ndarray]
    kind: str
    seconds: float

    @property
    def deviation(self) -> np.ndarray:
        """An estimate of the picture's error, (SIZE, SIZE, 3): half of the difference of the halves."""
        return (self.halves[0] - self.halves[1]) / 2


class Renderer:
    """A contestant that has loaded a scene, in a process of its own, and knows how many samples take a given time."""

    def __init__(self, contestant: Contestant, peer: Peer, scene: str, folder: Path) -> None:
        self._peer, self._path = peer, folder / contestant.name
        self.version = str(peer.ask("load", scene=scene, method=contestant.method)["version"])
        self._startup = self._fixed = self._each = 0.0

    def calibrate(self, seconds: float) -> None:
        """Measures the time of start-up, of what comes once per picture (training, photons) and of a sample.

        The first pictures are not counted: they compile. Start-up is what a plain picture of one sample takes, without the time
        of the sample.
        """
        for plain in (True, False):
            self._ask(1, plain=plain)
        one = min((self._ask(1, number, plain=True) for number in range(3)), key=lambda answer: float(answer["seconds"]))
        few, samples = self._ask(2), 8
        while True:
            many = self._ask(samples)
            if many["seconds"] - one["seconds"] > _ENOUGH * seconds or samples >= _MOST_SAMPLES:
                break
            few, samples = many, 4 * samples
        more = max(many["samples"] - few["samples"], 1)
        self._each = max((many["seconds"] - few["seconds"]) / more, 1e-6)
        self._startup = max(one["seconds"] - self._each * one["samples"], 0.0)
        self._fixed = max(many["seconds"] - self._startup - self._each * many["samples"], 0.0)

    def render(self, seconds: float, seed: int) -> Render:
        """Renders as many samples as probably take the given processor time, training included; returns what they took."""
        samples = max(1, min(round((seconds - self._fixed) / self._each), _MOST_SAMPLES))
        answer = self._ask(samples, seed)
        path = Path(answer["path"])
        picture = np.load(path) if path.suffix == ".npy" else read_image(path.read_bytes(), path.name)[..., :3]
        if picture.shape != (SIZE, SIZE, 3) or not np.isfinite(picture).all():
            raise RuntimeError(f"{self._path.name} gave a picture of shape {picture.shape} that is not finite everywhere")
        took = max(answer["seconds"] - self._startup, 1e-3)
        return Render(picture.astype(np.float32), took, int(answer["samples"]), self.version)

    def _ask(self, samples: int, seed: int = _CALIBRATION_SEED, plain: bool = False) -> dict[str, Any]:
        return self._peer.ask("render", samples=samples, seed=seed, path=str(self._path), plain=plain)


@contextmanager
def opened(contestant: Contestant, scene: str, seconds: float) -> Iterator[Renderer]:
    """Starts a contestant's process with a scene, and calibrates it for pictures of `seconds`; ends it with the `with` block."""
    with (
        tempfile.TemporaryDirectory(prefix="rayfarm-hard-") as folder,
        Peer(contestant.python(), contestant.program, __package__) as peer,
    ):
        renderer = Renderer(contestant, peer, scene, Path(folder))
        renderer.calibrate(seconds)
        yield renderer


@cache
def _state(contestant: Contestant, scene: str) -> str:
    """Returns a hash of what a contestant's pictures of a scene depend on, apart from our renderer."""
    sources = [(_HERE / name).read_text() for name in _PROGRAMS[contestant.program]]
    return hashlib.sha256("\0".join([contestant.method, SCENES[scene]().digest(), *sources]).encode()).hexdigest()[:16]


def _path(folder: Path, contestant: Contestant, scene: str, number: int, seconds: float) -> Path:
    own = kind() if contestant.is_ours else ""
    hashed = hashlib.sha256(f"{_state(contestant, scene)} {seconds:g} {own}".encode()).hexdigest()[:16]
    return folder / "pictures" / scene / f"{contestant.name}-{number}-{hashed}.npz"


def kept_render(folder: Path, contestant: Contestant, scene: str, number: int, seconds: float) -> Render | None:
    """Returns the picture of a round if the folder has it, of these sources; otherwise None. number: of the round, from 0."""
    path = _path(folder, contestant, scene, number, seconds)
    if not path.exists():
        return None
    with np.load(path) as found:
        return Render(found["picture"], float(found["seconds"]), int(found["samples"]), str(found["version"]))


def store_render(folder: Path, contestant: Contestant, scene: str, number: int, seconds: float, render: Render) -> None:
    """Keeps the picture of a round."""
    path = _path(folder, contestant, scene, number, seconds)
    _save(path, picture=render.picture, seconds=render.seconds, samples=render.samples, version=render.version)


def seed_of(number: int) -> int:
    """Returns the seed of a round."""
    return _FIRST_SEED + number


def _save(path: Path, **arrays: Any) -> None:
    """Writes arrays to a file that is never there in part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"part-{path.name}")
    np.savez(part, **arrays)
    part.replace(path)


def reference_of(folder: Path, scene: str, seconds: float) -> Reference:
    """Returns the reference of a scene: the mean of as many pictures with guiding or caustics on as take `seconds`.

    What the folder has is continued. It stays valid when the renderer changes, since the picture to which unbiased estimates
    converge does not.
    """
    contestant = ON[SCENES[scene]().kind]
    path = folder / "references" / f"{scene}-{_state(contestant, scene)}.npz"
    made: dict[str, Any] = {
        "sums": np.zeros((2, SIZE, SIZE, 3)),
        "samples": np.zeros(2),
        "seconds": 0.0,
        "parts": 0,
        "kind": kind(),
    }
    if path.exists():
        with np.load(path) as found:
            made = {name: found[name] for name in found.files}
    enough = _NEARLY * seconds
    if made["seconds"] < enough:
        with opened(contestant, scene, min(_PART_SECONDS, seconds / 2)) as renderer:
            while made["seconds"] < enough or made["parts"] % 2:
                part = renderer.render(min(_PART_SECONDS, seconds / 2), _REFERENCE_SEED + int(made["parts"]))
                half = int(made["parts"]) % 2
                made["sums"][half] += part.picture.astype(float) * part.samples
                made["samples"][half] += part.samples
                made = made | {"seconds": float(made["seconds"]) + part.seconds, "parts": int(made["parts"]) + 1}
                _save(path, **made)
    first, second = (made["sums"][half] / made["samples"][half] for half in range(2))
    return Reference((first + second) / 2, (first, second), str(made["kind"]), float(made["seconds"]))
