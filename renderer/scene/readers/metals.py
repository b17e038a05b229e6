"""Complex indices of refraction eta + i k of metals, as (eta, k) at the Rec.709 primaries.

n and k at vacuum wavelengths were averaged with the weights by which Rec.709's red, green and blue follow from a spectrum (CIE
1931 2 degree observer, as fitted by Wyman, Sloan and Shirley, JCGT 2(2), 2013; equal-energy light is white). The reflectance at
normal incidence is within 0.04 of that of the measured spectrum, even where gold's red is clamped.
tests/renderer/scene/test_metals.py recomputes the average.

Sources, by way of refractiveindex.info: gold, silver, copper: P. B. Johnson, R. W. Christy, Phys. Rev. B 6, 4370 (1972).
Iron, chromium, titanium, nickel: the same, Phys. Rev. B 9, 5056 (1974). Aluminium: F. Cheng et al., ACS Nano 10, 9852
(2016). Tungsten: J. H. Weaver, C. G. Olson, D. W. Lynch, Phys. Rev. B 12, 1293 (1975). Platinum: A. D. Rakic et al., Appl.
Opt. 37, 5271 (1998), Lorentz-Drude fit. Brass (70 % copper, 30 % zinc): M. R. Querry, CRDC-CR-85034 (1985).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Vec3

__all__ = ["METALS", "normal_reflectance"]

METALS: dict[str, tuple[Vec3, Vec3]] = {
    "aluminium": ((0.839, 0.575, 0.364), (6.079, 5.223, 4.173)),
    "brass": ((0.433, 0.514, 1.146), (3.584, 2.694, 1.749)),
    "chromium": ((3.224, 3.117, 2.256), (3.291, 3.339, 3.113)),
    "copper": ((0.237, 1.037, 1.298), (3.244, 2.601, 2.353)),
    "gold": ((0.108, 0.489, 1.478), (3.509, 2.337, 1.809)),
    "iron": ((2.917, 2.921, 2.532), (3.065, 2.939, 2.742)),
    "nickel": ((2.010, 1.904, 1.719), (4.121, 3.574, 2.863)),
    "platinum": ((2.318, 2.077, 1.819), (4.171, 3.673, 3.068)),
    "silver": ((0.055, 0.055, 0.043), (4.293, 3.543, 2.534)),
    "titanium": ((2.716, 2.511, 2.227), (3.791, 3.403, 2.999)),
    "tungsten": ((3.622, 3.496, 3.312), (2.908, 2.750, 2.496)),
}


def normal_reflectance(eta: npt.ArrayLike, k: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Returns the reflectance at normal incidence for complex indices eta + i k."""
    n, absorbs = np.asarray(eta, np.float64), np.asarray(k, np.float64)
    return np.asarray(((n - 1) ** 2 + absorbs**2) / ((n + 1) ** 2 + absorbs**2))
