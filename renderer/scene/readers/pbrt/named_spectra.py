"""Named spectra of pbrt: metals, glasses and lights.

Metals: eta and k at Rec.709's primaries. eta is the mean over the measured spectrum, and k gives the spectrum's reflectance
at normal incidence in daylight; tests/renderer/scene/test_pbrt_colors.py recomputes them. Measurements: the tables of
luxpop.com, which pbrt and Mitsuba share; brass as in metals.py. Glasses: index at 587.6 nm and Abbe number, from Schott's
catalogues. Lights: chromaticities of CIE 015:2018.
"""

from __future__ import annotations

from renderer.scene.description import Vec3
from renderer.scene.readers.metals import METALS as BRASS

__all__ = ["CHROMATICITIES", "GLASSES", "METALS"]

METALS: dict[str, tuple[Vec3, Vec3]] = {
    "Ag": ((0.1285, 0.1235, 0.1509), (4.0948, 3.3274, 2.4087)),
    "Al": ((1.4075, 0.9266, 0.5840), (7.6841, 6.5960, 5.3302)),
    "Au": ((0.0799, 0.4048, 1.5614), (12.5933, 2.3384, 1.7177)),
    "Cu": ((0.1042, 0.9781, 1.2047), (2.8515, 2.6235, 2.3607)),
    "CuZn": BRASS["brass"],
    "MgO": ((1.7337, 1.7409, 1.7535), (0.0120, 0.0000, 0.0011)),
    "TiO2": ((2.8601, 2.9571, 3.1855), (0.0044, 0.0336, 0.0223)),
}

GLASSES = {
    "glass-BK7": (1.5168, 64.17),
    "glass-BAF10": (1.67003, 47.11),
    "glass-FK51A": (1.48656, 84.47),
    "glass-LASF9": (1.85025, 32.17),
    **dict.fromkeys(("glass-F5", "glass-SF5"), (1.67271, 32.21)),
    **dict.fromkeys(("glass-F10", "glass-SF10"), (1.72825, 28.41)),
    **dict.fromkeys(("glass-F11", "glass-SF11"), (1.78472, 25.76)),
}

CHROMATICITIES = {
    "stdillum-A": (0.44757, 0.40745),
    "stdillum-D50": (0.34567, 0.35850),
    "stdillum-D65": (0.31272, 0.32903),
    "stdillum-F1": (0.31310, 0.33727),
    "stdillum-F2": (0.37208, 0.37529),
    "stdillum-F3": (0.40910, 0.39430),
    "stdillum-F4": (0.44018, 0.40329),
    "stdillum-F5": (0.31379, 0.34531),
    "stdillum-F6": (0.37790, 0.38835),
    "stdillum-F7": (0.31292, 0.32933),
    "stdillum-F8": (0.34588, 0.35875),
    "stdillum-F9": (0.37417, 0.37281),
    "stdillum-F10": (0.34609, 0.35986),
    "stdillum-F11": (0.38052, 0.37713),
    "stdillum-F12": (0.43695, 0.40441),
    "illum-acesD60": (0.32168, 0.33767),
}
