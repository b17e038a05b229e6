"""The resolved values of shader inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from renderer.scene.description import UvTransform
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.textures import Images, Taken

__all__ = ["Follow", "Following", "Input"]


@dataclass(frozen=True)
class Input:
    """A resolved shader input: a value, a texture, a primvar of the mesh, or the product of texture and primvar."""

    value: Any = None
    taken: Taken | None = None
    primvar: str | None = None

    def number(self, default: float) -> float:
        """Its value as a number."""
        if isinstance(self.value, (int, float)):
            return float(self.value)
        return default

    def color(self, default: tuple[float, float, float]) -> tuple[float, float, float]:
        """Returns its value as three numbers; a single number is repeated as grey."""
        if isinstance(self.value, (int, float)):
            return (float(self.value),) * 3
        try:
            r, g, b = (float(c) for c in tuple(self.value)[:3])
        except (TypeError, ValueError):
            return default
        return r, g, b


Follow = Callable[[Any, bool, int], Input]  # an input of a shader, whether its colours are encoded, and how far it is followed


class Following(Protocol):
    """What is known of a material while its network is followed."""

    images: Images
    notes: Notes
    time: Any
    user: str

    def coordinates(self, source: Any, depth: int) -> tuple[int, UvTransform]:
        """Which set of UVs a texture lies by, and what they go through first."""
        ...

    def primvar(self, name: str | None, fallback: Any) -> Input:
        """What a primvar is on the prim that shows the material."""
        ...

    def uv_set(self, name: str) -> int:
        """The number of a set of UVs by its primvar's name."""
        ...
