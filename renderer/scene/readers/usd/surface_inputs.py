"""Reads the inputs of a MaterialX surface, and notes the unsupported ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from renderer.scene.description import Vec3
from renderer.scene.readers.usd.inputs import Input
from renderer.scene.readers.usd.preview_surface import Read
from renderer.sentences import Sentence

__all__ = ["SurfaceInputs"]

_WHITE: Vec3 = (1.0, 1.0, 1.0)


class SurfaceInputs:
    """The inputs of a MaterialX surface shader; adds notes about textures and inputs that are left out."""

    def __init__(self, shader: Any, read: Read) -> None:
        self._shader, self._read = shader, read

    def __call__(self, name: str, srgb: bool = False) -> Input:
        """Returns an input of the shader. srgb: whether its texture is sRGB-encoded if the file does not specify."""
        return self._read.network.input(self._shader, name, srgb)

    def number(self, name: str, default: float) -> float:
        """Returns an input as a number; a texture is left out with a note."""
        return self._constant_value(name, self(name)).number(default)

    def color(self, name: str, default: Vec3 = _WHITE) -> Vec3:
        """Returns an input as a colour; a texture is left out with a note."""
        return self._constant_value(name, self(name, True)).color(default)

    def _constant_value(self, name: str, given: Input) -> Input:
        if given.taken is not None or given.primvar is not None:
            self._note(
                Sentence(
                    "usd-materialx-texture-left-out",
                    "Textures of the input {input} of MaterialX surfaces are left out",
                    input=name,
                )
            )
        return given

    def leave_out(self, neutral: Mapping[str, float | Vec3]) -> None:
        """Adds notes about unsupported inputs whose values differ from the neutral ones. neutral: values by input name."""
        for name, value in neutral.items():
            given = self(name)
            plain = (value,) * 3 if isinstance(value, (int, float)) else value
            if given.taken is not None or max(abs(a - b) for a, b in zip(given.color(plain), plain, strict=True)) > 1e-6:
                self._note(
                    Sentence("usd-materialx-input-left-out", "The input {input} of MaterialX surfaces is left out", input=name)
                )

    def _note(self, what: str) -> None:
        self._read.network.notes.add(what, self._read.network.user)
