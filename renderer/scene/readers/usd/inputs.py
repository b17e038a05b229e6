"""Values of shader inputs, resolved through the shader network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from renderer.scene.description import UvTransform
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.textures import Images, TextureInput

__all__ = ["Follow", "Input", "NetworkContext"]


@dataclass(frozen=True)
class Input:
    """A resolved shader input: a value, a texture, a primvar of the mesh, or the product of a texture and a primvar."""

    value: Any = None
    taken: TextureInput | None = None
    primvar: str | None = None

    def number(self, default: float) -> float:
        """Returns the value as a number, or the default if it is not a number."""
        if isinstance(self.value, (int, float)):
            return float(self.value)
        return default

    def color(self, default: tuple[float, float, float]) -> tuple[float, float, float]:
        """Returns the value as an RGB colour, with a single number repeated as grey, or the default if it is not a colour."""
        if isinstance(self.value, (int, float)):
            return (float(self.value),) * 3
        try:
            r, g, b = (float(c) for c in tuple(self.value)[:3])
        except (TypeError, ValueError):
            return default
        return r, g, b


Follow = Callable[[Any, bool, int], Input]  # arguments: shader input, whether its colours are sRGB, depth


class NetworkContext(Protocol):
    """The interface of `Network`, as seen by the functions that evaluate the nodes of one material's shader network."""

    images: Images
    notes: Notes
    time: Any
    user: str

    def coordinates(self, source: Any, depth: int) -> tuple[int, UvTransform]:
        """Returns the UV set of a texture, and the transform applied to its UVs."""
        ...

    def primvar(self, name: str | None, fallback: Any) -> Input:
        """Returns the value of a primvar on the prim to which the material is bound; the fallback if the prim lacks it."""
        ...

    def uv_set(self, name: str) -> int:
        """Returns the index of the UV set whose primvar has this name."""
        ...
