"""Converged pictures, cached between runs, since they take longer than everything that is compared with them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from renderer.jit import kind
from tests.benchmarks.peers.contestants import converged
from tests.benchmarks.peers.sizes import Sizes

__all__ = ["OURS", "References"]

OURS = f"ours {kind()}"  # changes with every change of the renderer
_MADE_BY = ("contestants.py", "cycles.py", "files.py", "meshes.py", "scenes.py")


@dataclass(frozen=True)
class References:
    """Cache of the converged pictures with which a run compares. folder: where they are stored; None: they are not stored."""

    sizes: Sizes
    folder: Path | None

    def of(self, case: str, side: str, picture: Callable[[int, int], np.ndarray]) -> np.ndarray:
        """Returns a converged picture (h, w, 3): the cached one, or a new one rendered by `picture`.

        case: name of the scene. side: the renderer and its version.
        """
        if self.folder is None:
            return converged(picture, self.sizes.reference_spp)
        path = self.folder / f"{case.replace(' ', '-').replace(',', '')}-{side.split()[0]}-{self._name(case, side)}.npy"
        if not path.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(".part.npy")
            np.save(part, converged(picture, self.sizes.reference_spp))
            part.replace(path)
        return np.asarray(np.load(path))

    def _name(self, case: str, side: str) -> str:
        """Returns the part of the cached file's name that changes with everything that the picture depends on (a hash)."""
        sources = [(Path(__file__).parent / name).read_text() for name in _MADE_BY]
        return hashlib.sha256("\0".join([case, side, repr(self.sizes), *sources]).encode()).hexdigest()[:16]
