"""A picture in memory: arrays by AOV name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer import aovs
from renderer.image import encode, tonemap
from renderer.image.ocio import curve_of

__all__ = ["Image"]

F32 = npt.NDArray[np.float32]


class Image(Mapping[str, F32]):
    """A picture as arrays by name.

    "color" is scene-linear Rec.709 radiance, (h, w, 3) float32; the requested AOVs are (h, w) or (h, w, 3), as in
    renderer.aovs.values; "denoised" is present if requested. With a transparent background the colours are premultiplied by
    "alpha", (h, w), if that is among the AOVs.

    spp: mean samples per pixel. total: target of spp; None if only a noise level or a time limit ends rendering. noise: relative
    noise; None while unknown.
    """

    def __init__(
        self,
        names: Sequence[str],
        values: Callable[[str], F32],
        spp: float,
        total: int | None = None,
        noise: float | None = None,
        is_final: bool = True,
    ) -> None:
        self._names, self._values = tuple(names), values
        self._known: dict[str, F32] = {}
        self.spp, self.of, self.noise, self.is_final = spp, total, noise, is_final

    def __getitem__(self, name: str) -> F32:
        if name not in self._names:
            raise KeyError(f"{name!r} is not in this picture; it has {', '.join(self._names)}")
        if name not in self._known:
            self._known[name] = self._values(name)
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @property
    def width(self) -> int:
        """Width in pixels."""
        return int(self["color"].shape[1])

    @property
    def height(self) -> int:
        """Height in pixels."""
        return int(self["color"].shape[0])

    def shown(self, name: str = "color", exposure: float = 0.0, tonemap_curve: str = "neutral") -> npt.NDArray[np.uint8]:
        """Returns the image for display, (h, w, 3) uint8 sRGB. Raises KeyError, or SettingsError for an unknown curve.

        Colours are exposed (in stops) and tone-mapped, by a curve or by an OCIO view, as `ocio:VIEW` (renderer.image.ocio), with
        straight alpha as a fourth channel if the picture has "alpha"; other AOVs are mapped as on the web page.
        """
        plane = self[name]
        if name in ("color", "denoised") and aovs.ALPHA in self:
            return tonemap.apply_straight(plane, self[aovs.ALPHA], exposure, curve_of(tonemap_curve))
        if name in ("color", "denoised"):
            return tonemap.apply(plane, exposure, curve_of(tonemap_curve))
        return aovs.visible(name, plane)

    def save(self, path: str | Path, exposure: float = 0.0, tonemap_curve: str = "neutral") -> None:
        """Writes the picture as .png or .jpg (as `shown` returns it, no alpha in .jpg), .avif, .jxl, .exr (with layers) or .hdr.

        If "denoised" is present, it replaces the colour; an .exr contains both. Raises SettingsError for another suffix.
        """
        names = [name for name in self if name not in ("color", "denoised", aovs.ALPHA)]
        channels = aovs.layers({name: self[name] for name in names})
        color = self["denoised"] if "denoised" in self else self["color"]
        if "denoised" in self:
            channels |= {f"Noisy Image.{c}": self["color"][..., i] for i, c in enumerate("RGB")}
        alpha, curve = self.get(aovs.ALPHA), curve_of(tonemap_curve)
        encode.write(path, color, exposure=exposure, curve=curve, channels=channels, alpha=alpha)

    def _repr_png_(self) -> bytes:
        return encode.encode_shown(self.shown("denoised" if "denoised" in self else "color"), "png")

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return np.array(self["color"], dtype=dtype, copy=copy)

    def __repr__(self) -> str:
        of = "" if self.of is None else f" of {self.of}"
        noise = "" if self.noise is None else f", noise {self.noise:.3g}"
        return f"<Image {self.width}x{self.height}, {self.spp:g}{of} samples{noise}: {', '.join(self)}>"
