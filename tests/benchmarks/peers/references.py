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
    """The converged pictures of a run. folder: the cache; None: no cache."""

    sizes: Sizes
    folder: Path | None

    def of(self, case: str, side: str, picture: Callable[[int, int], np.ndarray]) -> np.ndarray:
        """Returns the converged picture (h, w, 3) of a case, from the cache or rendered by `picture`.

        side: renderer and version.
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
        """Returns the picture's cache key, a hash of everything that the picture depends on."""
        sources = [(Path(__file__).parent / name).read_text() for name in _MADE_BY]
        return hashlib.sha256("\0".join([case, side, repr(self.sizes), *sources]).encode()).hexdigest()[:16]
