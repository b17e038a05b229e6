"""Tests of metals by name: their optical constants follow from measurements, and their colours match published ones."""

import numpy as np
import pytest

from renderer.scene.metal_spectra import MEASURED, NAMED
from renderer.scene.readers.metals import METALS
from renderer.scene.readers.mitsuba.metals import CONDUCTORS
from renderer.scene.readers.pbrt.named_spectra import METALS as PBRT_METALS

WAVELENGTHS = np.arange(380.0, 731.0)


def weights():
    """Returns (3, W) weights of each wavelength of equal-energy white in red, green and blue; each row sums to 1."""

    def lobe(height, middle, below, above):
        t = (WAVELENGTHS - middle) * np.where(middle > WAVELENGTHS, below, above)
        return height * np.exp(-0.5 * t * t)

    # Wyman, Sloan and Shirley 2013, the multi-lobe fit of the CIE 1931 observer.
    x = lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(-0.065, 501.1, 0.0490, 0.0382)
    y = lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322)
    z = lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725)
    to_rec709 = np.array(
        [(3.2404542, -1.5371385, -0.4985314), (-0.969266, 1.8760108, 0.041556), (0.0556434, -0.2040259, 1.0572252)]
    )
    rgb = to_rec709 @ np.stack([x, y, z])
    return rgb / rgb.sum(axis=1, keepdims=True)


def reflectance(n, k):
    return ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)


@pytest.mark.parametrize("metal", ["gold", "copper", "iron"])
def test_metal_indices_match_measurements(metal):
    table = np.array([row.split() for row in MEASURED[metal].split(",")], float)
    n, k = (np.interp(WAVELENGTHS, table[:, 0], table[:, c]) for c in (1, 2))
    eta, kappa = METALS[metal]
    np.testing.assert_allclose(eta, weights() @ n, atol=0.0006)
    np.testing.assert_allclose(kappa, weights() @ k, atol=0.0006)
    of_spectrum = weights() @ reflectance(n, k)
    np.testing.assert_allclose(reflectance(np.array(eta), np.array(kappa)), of_spectrum, atol=0.04)


# Linear Rec.709 reflectance at normal incidence: S. Lagarde, Memo on Fresnel equations, 2013.
@pytest.mark.parametrize(
    ("metal", "known"),
    [
        ("gold", (1.0, 0.766, 0.336)),
        ("silver", (0.972, 0.960, 0.915)),
        ("copper", (0.955, 0.638, 0.538)),
        ("aluminium", (0.913, 0.922, 0.924)),
        ("iron", (0.562, 0.565, 0.578)),
        ("chromium", (0.549, 0.556, 0.554)),
        ("titanium", (0.542, 0.497, 0.449)),
        ("nickel", (0.660, 0.609, 0.526)),
        ("platinum", (0.673, 0.637, 0.585)),
    ],
)
def test_metal_colors_match_published_ones(metal, known):
    eta, k = METALS[metal]
    # Measured films differ by how they were made, most for titanium.
    np.testing.assert_allclose(
        reflectance(np.array(eta), np.array(k)), known, atol=0.1 if metal in ("titanium", "iron") else 0.07
    )


def test_colors_of_brass_and_tungsten():
    red, green, blue = reflectance(*(np.array(v) for v in METALS["brass"]))
    assert red > green > 1.7 * blue
    grey = reflectance(*(np.array(v) for v in METALS["tungsten"]))
    assert np.ptp(grey) < 0.06
    assert 0.4 < grey.mean() < 0.55


def test_named_metals_are_those_of_the_readers():
    known = [METALS[name] for name in ("gold", "copper", "iron")]
    known += [table[name] for name in ("Ag", "Al", "Au", "Cu") for table in (CONDUCTORS, PBRT_METALS)]
    assert list(NAMED) == known
