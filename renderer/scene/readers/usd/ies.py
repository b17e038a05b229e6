"""IES profiles of UsdLux lights, named by UsdLuxShapingAPI.

Source: the schema; where hdEmbree's reference implementation differs, that implementation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import UsdLux

from renderer.errors import SceneError
from renderer.scene.description import EmissionMap
from renderer.scene.emission_maps import flux_of
from renderer.scene.files import SceneFiles
from renderer.scene.readers.ies import Photometry, read_ies
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.textures import Images
from renderer.sentences import Sentence, with_full_stop

__all__ = ["Profiles"]

_ROWS = 721
_LEAST_SCALE = 1e-6
_HEMISPHERE = math.pi / 2 + 0.1  # largest span in radians of profiles that are normalised over a hemisphere


class Profiles:
    """Reads the IES profiles of lights; lights with the same profile and shaping share an emission map."""

    def __init__(self, images: Images, files: SceneFiles, notes: Notes, time: Any) -> None:
        self._images, self._files, self._notes, self._time = images, files, notes, time

    def profile_attribute(self, prim: Any) -> Any:
        """Returns the attribute that contains the file name of a light's IES profile; None if the light has no profile."""
        if not prim.HasAPI(UsdLux.ShapingAPI):
            return None
        attribute = UsdLux.ShapingAPI(prim).GetShapingIesFileAttr()
        value = attribute.Get(self._time)
        return attribute if value is not None and value.path else None

    def emission(self, prim: Any, attribute: Any, is_flat: bool) -> EmissionMap | None:
        """Returns a light's emission map, which scales its radiance by direction: axis -Z, with -X to the right.

        is_flat: whether the light is a disk or rectangle, whose intensity falls off with the cosine. Returns None, with a note,
        if the profile is missing or unreadable.
        """
        file = self._images.file(attribute, self._time)
        if file is None:
            self._notes.add(
                Sentence("usd-ies-profile-missing", "IES profiles that are not among the files are left out; add them"),
                str(prim.GetPath()),
            )
            return None
        shaping = UsdLux.ShapingAPI(prim)
        scale = 1.0 + (shaping.GetShapingIesAngleScaleAttr().Get(self._time) or 0.0)
        even = bool(shaping.GetShapingIesNormalizeAttr().Get(self._time))
        key = "IES of USD", file[0], scale, even, is_flat
        try:
            found: tuple[EmissionMap, list[str]] = self._files.get_or_make(
                key, lambda: _profile_emission_map(read_ies(file[1](), file[0]), scale, even, is_flat)
            )
        except SceneError as error:
            self._notes.add_sentence(Sentence("usd-ies-profile-invalid", "{error}; lights shine without it.", error=error))
            return None
        for note in found[1]:
            self._notes.add_sentence(with_full_stop(note))
        return found[0]


def _profile_emission_map(
    photometry: Photometry, scale: float, is_normalised: bool, is_flat: bool
) -> tuple[EmissionMap, list[str]]:
    """Returns the emission map of a profile, and the notes of its reader.

    scale: factor of the vertical angles, measured from the zenith (theta = pi). is_normalised: whether to normalise the values
    to a mean of 1 over the sphere, or over the hemisphere for profiles within one. is_flat: whether to multiply them by
    cos(theta).
    """
    emission = photometry.emission
    left, right, top, bottom = emission.edges
    values = emission.values.astype(np.float64)
    if is_normalised:
        whole = (2 if bottom - top <= _HEMISPHERE else 4) * math.pi
        values = values * (whole / max(float(flux_of(emission)[0]), 1e-300))
    if scale != 1.0 or is_flat:
        theta = np.linspace(0.0, math.pi, max(_ROWS, len(values)))
        wanted = np.clip((theta - math.pi) / max(scale, _LEAST_SCALE) + math.pi, 0.0, math.pi)
        own = np.linspace(top, bottom, len(values))
        columns = values[..., 0].T
        rows = np.stack([np.interp(wanted, own, column, left=0.0, right=0.0) for column in columns], axis=1)
        if is_flat:
            rows *= np.maximum(np.cos(theta), 0.0)[:, None]
        values, top, bottom = np.repeat(rows[..., None], 3, axis=2), 0.0, math.pi
    shaped = EmissionMap("sphere", values.astype(np.float32), (left, right, top, bottom), at_edges=True)
    return shaped, photometry.notes
