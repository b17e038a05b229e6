"""FLIP (Andersson et al. 2020), an error metric of pictures, in NumPy with full two-dimensional filters.

It is the reference for the page's implementation.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

__all__ = ["flip"]

PPD = 67.0206  # pixels per degree of a screen 3840 pixels and 0.7 m wide, seen from 0.7 m
WHITE = np.array([0.950428545, 1.0, 1.088900371])
XYZ = np.array(
    [
        [0.41239080, 0.35758434, 0.18048079],
        [0.21263901, 0.71516868, 0.07219232],
        [0.01933082, 0.11919478, 0.95053215],
    ]
)
CSF = (((1, 0.0047), (0, 1e-5)), ((1, 0.0053), (0, 1e-5)), ((34.1, 0.04), (13.5, 0.025)))


def _grid(radius: int) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return x.astype(float), y.astype(float)


def _lab(rgb: np.ndarray) -> np.ndarray:
    t = rgb @ XYZ.T / WHITE
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    lightness = 116 * f[..., 1] - 16
    a, b = 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])
    return np.stack([lightness, 0.01 * lightness * a, 0.01 * lightness * b], axis=-1)  # with the Hunt effect


def _hyab(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    d = a - b
    return np.abs(d[..., 0]) + np.hypot(d[..., 1], d[..., 2])


def flip(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the FLIP error of every pixel, (h, w), between two sRGB-encoded pictures, (h, w, 3) with values of 0 to 1."""
    seen, features = [], []
    for picture in (a, b):
        linear = np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
        t = linear @ XYZ.T / WHITE
        y = 116 * t[..., 1] - 16
        opponent = [y, 500 * (t[..., 0] - t[..., 1]), 200 * (t[..., 1] - t[..., 2])]
        x_, y_ = _grid(int(np.ceil(3 * np.sqrt(0.04 / (2 * np.pi**2)) * PPD)))
        square = (x_**2 + y_**2) / PPD**2
        filtered = []
        for plane, terms in zip(opponent, CSF, strict=True):
            kernel = np.sum([p * np.sqrt(np.pi / q) * np.exp(-(np.pi**2) * square / q) for p, q in terms], axis=0)
            filtered.append(ndimage.correlate(plane, kernel / kernel.sum(), mode="nearest"))
        fy = (filtered[0] + 16) / 116
        back = np.stack([filtered[1] / 500 + fy, fy, fy - filtered[2] / 200], axis=-1) * WHITE
        seen.append(_lab(np.clip(back @ np.linalg.inv(XYZ).T, 0, 1)))
        deviation = 0.5 * 0.082 * PPD
        x_, y_ = _grid(int(np.ceil(3 * deviation)))
        bell = np.exp(-(x_**2 + y_**2) / (2 * deviation**2))
        norms = []
        for kernel in (-x_ * bell, (x_**2 / deviation**2 - 1) * bell):
            kernel = np.where(kernel > 0, kernel / kernel[kernel > 0].sum(), -kernel / kernel[kernel < 0].sum())
            both = [ndimage.correlate((y + 16) / 116, each, mode="nearest") for each in (kernel, kernel.T)]
            norms.append(np.hypot(*both))
        features.append(norms)
    most = _hyab(_lab(np.array([0.0, 1, 0])), _lab(np.array([0.0, 0, 1]))) ** 0.7
    colour = _hyab(*seen) ** 0.7
    colour = np.where(colour < 0.4 * most, 0.95 / (0.4 * most) * colour, 0.95 + 0.05 * (colour - 0.4 * most) / (0.6 * most))
    strength = np.max([np.abs(p - q) for p, q in zip(*features, strict=True)], axis=0)
    found: np.ndarray = colour ** (1 - np.sqrt(strength / np.sqrt(2)))
    return found
