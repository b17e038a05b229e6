"""The names of the preset environments, offered by requests, --env and the page besides images, colours and skies.

The formulas are in renderer/scene/presets.py. This module contains no pixels, so that the service can list the names.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["PRESETS", "Preset"]


class Preset(NamedTuple):
    """A preset environment, with its texts for users.

    sky: if the preset is a clear sky, the elevation and the azimuth of its sun in degrees; None for other presets.
    """

    label: str
    help: str
    sky: tuple[float, float] | None = None


PRESETS = {
    "studio": Preset("Studio", "Soft boxes left, right and above, over a floor that brightens towards the horizon."),
    "dark-studio": Preset("Dark studio", "Two long strip lights and a rim in a black room: for metal, glass and paint."),
    "even-white": Preset("Even white", "Uniform white from every direction: no hard shadows."),
    "overcast": Preset("Overcast", "A cloudy day: three times brighter above than at the horizon, and no sun."),
    "low-sun": Preset("Low sun", "A clear sky, the sun low on one side: warm, with long shadows.", (8.0, 110.0)),
    "morning": Preset("Morning", "A clear sky, the sun a quarter of its way up.", (22.0, 125.0)),
    "noon": Preset("Noon", "A clear sky, the sun high.", (62.0, 160.0)),
}
