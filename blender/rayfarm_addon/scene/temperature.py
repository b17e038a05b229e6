"""The colour of a black body as in Blender: linear sRGB of luminance 1, from 800 to 12,000 K."""

from __future__ import annotations

import bisect

__all__ = ["blackbody"]

# Values of Blender's lamps (Light.temperature_color), which equal those of the Blackbody node.
TABLE = (
    (800, (5.4138, 0.0, 0.0)),
    (900, (4.9839, 0.0, 0.0)),
    (1000, (4.6013, 0.039, 0.0)),
    (1150, (4.1098, 0.1852, 0.0)),
    (1300, (3.7027, 0.3055, 0.0)),
    (1500, (3.2643, 0.434, 0.0)),
    (1750, (2.8425, 0.5558, 0.0)),
    (2000, (2.5201, 0.6469, 0.0204)),
    (2300, (2.2242, 0.7278, 0.0893)),
    (2650, (1.9662, 0.7956, 0.1785)),
    (3000, (1.7708, 0.8443, 0.2722)),
    (3400, (1.5996, 0.8848, 0.3789)),
    (3900, (1.4407, 0.9183, 0.5088)),
    (4500, (1.3008, 0.9455, 0.6526)),
    (5200, (1.1835, 0.9655, 0.8034)),
    (6000, (1.0887, 0.9783, 0.9531)),
    (6500, (1.0425, 0.9841, 1.0353)),
    (7000, (1.0056, 0.9873, 1.109)),
    (8000, (0.9473, 0.9916, 1.2371)),
    (9500, (0.8866, 0.9946, 1.3888)),
    (12000, (0.8263, 0.9945, 1.5663)),
)
KELVINS = [kelvin for kelvin, _ in TABLE]


def blackbody(kelvin: float) -> list[float]:
    """Returns the colour of a black body at a temperature, interpolated linearly in the table over the inverse temperature."""
    if kelvin <= KELVINS[0] or kelvin >= KELVINS[-1]:
        return list(TABLE[0 if kelvin <= KELVINS[0] else -1][1])
    at = bisect.bisect(KELVINS, kelvin)
    (low, first), (high, second) = TABLE[at - 1], TABLE[at]
    share = (1 / low - 1 / kelvin) / (1 / low - 1 / high)
    return [a + share * (b - a) for a, b in zip(first, second, strict=True)]
