"""Converts scene-linear radiance to display values: exposure, a tone curve, the sRGB encoding.

Every curve converts scene-linear Rec.709 radiance, (..., 3) float32, not negative, to display-linear Rec.709 in 0..1.
The live view's shader (web/) has the same formulas: change both, so that the view matches the downloaded picture.
Views of an OpenColorIO config (ocio.py) take the place of a curve and of the encoding.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from renderer.errors import SettingsError
from renderer.luminance import REC_709
from renderer.sentences import Sentence

__all__ = [
    "CURVES",
    "Curve",
    "DisplayTransform",
    "agx",
    "apply",
    "apply_straight",
    "check_pq",
    "check_standard_range",
    "decode_srgb",
    "encode_srgb",
    "exposed",
    "filmic",
    "hue",
    "key_of",
    "neutral",
    "reinhard",
    "srgb",
]

F32 = npt.NDArray[np.float32]


class DisplayTransform(Protocol):
    """A transform to a display's encoded values, in place of a curve and the sRGB encoding. key: identifies it, for caches."""

    @property
    def key(self) -> str:
        """Returns a text that identifies the transform: transforms with different results have different texts."""
        ...

    @property
    def is_pq(self) -> bool:
        """Returns True if the display expects a PQ signal (ITU-R BT.2100)."""
        ...

    def encode(self, rgb: F32) -> F32:
        """Returns display-encoded values of scene-linear Rec.709 radiance, (..., 3) float32, not negative."""
        ...


Curve = str | DisplayTransform  # the name of a curve, or a transform


def check_pq(curve: Curve) -> None:
    """Raises SettingsError for a transform whose display does not take the PQ signal of BT.2100."""
    if not isinstance(curve, str) and not curve.is_pq:
        raise SettingsError(
            Sentence(
                "still-view-not-pq",
                "files of high dynamic range take an OCIO view of a Rec.2100-PQ display, or none: leave the tone curve out",
            )
        )


def check_standard_range(curve: Curve) -> None:
    """Raises SettingsError for a transform whose display takes the PQ signal of BT.2100: a gain map adds to standard range."""
    if not isinstance(curve, str) and curve.is_pq:
        raise SettingsError(
            Sentence(
                "gain-map-view-pq",
                "a gain map is for pictures of standard range: leave out the gain map, or the OCIO view of a Rec.2100-PQ display",
            )
        )


def key_of(curve: Curve) -> str:
    """Returns text that differs for curves with different results."""
    return curve if isinstance(curve, str) else curve.key


_LUMINANCE = REC_709.astype(np.float32)


def neutral(rgb: F32) -> F32:
    """Khronos PBR Neutral tone curve: preserves base colours; only highlights are compressed and desaturated.

    Source: KhronosGroup/ToneMapping, PBR_Neutral/README.md.
    """
    start, desaturation = np.float32(0.8 - 0.04), np.float32(0.15)
    low = np.minimum(np.minimum(rgb[..., 0], rgb[..., 1]), rgb[..., 2])[..., None]  # ten times as fast as min(axis=-1)
    rgb = rgb - np.where(low < 0.08, low - 6.25 * low * low, np.float32(0.04))
    peak = np.maximum(np.maximum(rgb[..., 0], rgb[..., 1]), rgb[..., 2])[..., None]
    room = 1 - start
    new_peak = 1 - room * room / (np.maximum(peak, start) + room - start)
    grey = 1 - 1 / (desaturation * (peak - new_peak) + 1)
    squeezed = rgb * (new_peak / np.maximum(peak, start))
    return np.where(peak < start, rgb, squeezed + (new_peak - squeezed) * grey)


def srgb(rgb: F32) -> F32:
    """Clips at 1, without a tone curve."""
    return np.minimum(rgb, np.float32(1))


def hue(rgb: F32) -> F32:
    """Clips at 1 and preserves the hue: divides a pixel above 1 by its greatest channel. `srgb` turns orange into yellow."""
    peak = np.maximum(np.maximum(rgb[..., 0], rgb[..., 1]), rgb[..., 2])[..., None]
    return np.divide(rgb, np.maximum(peak, 1), dtype=np.float32)


def reinhard(rgb: F32) -> F32:
    """Reinhard tone curve, x / (1 + luminance). Source: Reinhard et al., Photographic Tone Reproduction, 2002, equation 3."""
    return rgb / (1 + rgb @ _LUMINANCE)[..., None]


def filmic(rgb: F32) -> F32:
    """Fitted ACES reference tone curve. Source: K. Narkowicz, ACES Filmic Tone Mapping Curve, 2015."""
    x: F32 = np.minimum(rgb, np.float32(1e6))
    return np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)


# On column vectors; the rows of AgX's inset and outset matrices.
_AGX_INSET = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ],
    np.float32,
)
_AGX_OUTSET = np.array(
    [
        [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
        [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
        [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
    ],
    np.float32,
)
_AGX_MIN_EV, _AGX_MAX_EV = np.float32(-12.47393), np.float32(4.026069)


def agx(rgb: F32) -> F32:
    """AgX tone curve: bright saturated colours turn white, as on film.

    Sources: T. Sobotka, AgX; polynomial by B. Wrensch, Minimal AgX, 2023.
    """
    x = np.log2(np.maximum(rgb @ _AGX_INSET.T, np.float32(1e-10)))
    x = (np.clip(x, _AGX_MIN_EV, _AGX_MAX_EV) - _AGX_MIN_EV) / (_AGX_MAX_EV - _AGX_MIN_EV)
    x2 = x * x
    x4 = x2 * x2
    x = 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232
    return np.clip(x @ _AGX_OUTSET.T, 0, 1) ** np.float32(2.2)  # the curve ends in a display's 2.2 power encoding


_FUNCTIONS: dict[str, Callable[[F32], F32]] = {
    "neutral": neutral,
    "srgb": srgb,
    "hue": hue,
    "reinhard": reinhard,
    "filmic": filmic,
    "agx": agx,
}
CURVES: tuple[str, ...] = tuple(_FUNCTIONS)


def encode_srgb(linear: F32) -> F32:
    """Converts display-linear 0..1 to sRGB-encoded 0..1. Source: IEC 61966-2-1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-10) ** np.float32(1 / 2.4) - 0.055)


def decode_srgb(encoded: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Converts sRGB-encoded 0..1 to linear 0..1, of the same dtype. Source: IEC 61966-2-1."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def exposed(rgb: F32, exposure: float) -> F32:
    """Returns radiance times 2 ** exposure, from 0 to 1e18. NaN and negative values become 0."""
    scaled = np.asarray(rgb, np.float32) * np.float32(2.0 ** max(min(exposure, 60.0), -60.0))
    clean = np.nan_to_num(np.maximum(scaled, 0), nan=0.0, posinf=1e18).astype(np.float32, copy=False)
    return np.minimum(clean, np.float32(1e18))


def apply(rgb: F32, exposure: float = 0.0, curve: Curve = "neutral") -> npt.NDArray[np.uint8]:
    """Returns display values, (h, w, 3) uint8, of scene-linear (h, w, 3) float32 radiance.

    They are sRGB, or what the transform's display shows.

    exposure: stops; +1 doubles the radiance. NaN and negative values become black. Raises SettingsError for an unknown curve.
    """
    if isinstance(curve, str) and curve not in _FUNCTIONS:
        raise SettingsError(
            Sentence("tone-curve-unknown", "tone curve is {curve}; known are {curves}", curve=repr(curve), curves=[*CURVES])
        )
    clean = exposed(rgb, exposure)
    if isinstance(curve, str):
        encoded = encode_srgb(np.clip(_FUNCTIONS[curve](clean), 0, 1))
    else:
        encoded = np.clip(curve.encode(clean), 0, 1)
    return (encoded * 255 + 0.5).astype(np.uint8)


def apply_straight(rgb: F32, alpha: F32, exposure: float = 0.0, curve: Curve = "neutral") -> npt.NDArray[np.uint8]:
    """Returns display values with straight alpha, (h, w, 4) uint8, of premultiplied scene-linear (h, w, 3) radiance.

    The curve applies to the colour of what covers the pixel, radiance / alpha, so that edges are as bright as what is beside
    them; what is not covered is black. alpha: (h, w), 0 ... 1, stored linearly. exposure, curve: as for `apply`.
    """
    coverage = np.clip(np.nan_to_num(alpha), 0, 1)[..., None]
    color = np.divide(rgb, coverage, out=np.zeros_like(rgb, np.float32), where=coverage > 0)
    return np.concatenate([apply(color, exposure, curve), (coverage * 255 + 0.5).astype(np.uint8)], axis=-1)
