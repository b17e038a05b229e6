"""Notes for the user on colour metadata of image files that the decoders ignore. Each note names the file."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from PIL import Image, ImageCms

from renderer.sentences import Sentence

__all__ = ["header_notes", "pillow_notes", "primaries_notes", "profile_notes"]

_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
_EQUAL_ENERGY = (*_REC709[:6], 0.3333, 0.3333)  # the white that Radiance writes beside primaries of its own
_TOLERANCE = 0.01
_SRGB_GAMMA = 0.45455
_ORIENTATION = 0x0112  # of Exif


def pillow_notes(source: Image.Image, name: str) -> list[str]:
    """Returns notes on ignored metadata (colour profile, gamma, CMYK, orientation) of an image opened by Pillow."""
    notes = profile_notes(source.info.get("icc_profile"), name)
    gamma = source.info.get("gamma")
    if not notes and "srgb" not in source.info and gamma is not None and abs(gamma - _SRGB_GAMMA) > _TOLERANCE:
        notes.append(
            Sentence(
                "image-gamma-ignored",
                "{name}: its gamma of {gamma} is ignored; it is read as sRGB, whose gamma is {srgb_gamma}",
                name=name,
                gamma=f"{gamma:g}",
                srgb_gamma=f"{_SRGB_GAMMA:g}",
            )
        )
    if source.mode == "CMYK":
        notes.append(
            Sentence(
                "image-cmyk-without-profile",
                "{name}: its CMYK is converted to RGB without a colour profile; give it in RGB",
                name=name,
            )
        )
    try:
        frames, turned = getattr(source, "n_frames", 1), source.getexif().get(_ORIENTATION, 1)
    except Exception:  # on damaged metadata Pillow raises nearly every type; the pixels may be whole
        frames, turned = 1, 1
        notes.append(Sentence("image-metadata-damaged", "{name}: its metadata is damaged and not read", name=name))
    if frames > 1:
        notes.append(
            Sentence("image-frames-dropped", "{name} has {frames} frames; only the first is shown", name=name, frames=frames)
        )
    if turned not in (0, 1):
        notes.append(
            Sentence(
                "image-orientation-ignored",
                "{name}: its Exif orientation {orientation} is ignored; save it rotated",
                name=name,
                orientation=turned,
            )
        )
    return notes


def profile_notes(profile: Any, name: str) -> list[str]:
    """Returns a note if the colour profile (ICC) is not sRGB."""
    if not profile:
        return []
    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(bytes(profile)))
        title = ImageCms.getProfileDescription(opened).strip()
    except (OSError, ImageCms.PyCMSError, TypeError, ValueError):
        return [
            Sentence(
                "image-colour-profile-damaged",
                "{name}: its colour profile is damaged; its colours are read as sRGB. Convert it to sRGB",
                name=name,
            )
        ]
    if "srgb" in title.lower().replace(" ", ""):
        return []
    return [
        Sentence(
            "image-colour-profile-ignored",
            '{name}: its colour profile "{profile}" is ignored; its colours are read as sRGB. Convert it to sRGB',
            name=name,
            profile=title[:80],
        )
    ]


def primaries_notes(chromaticities: Any, name: str) -> list[str]:
    """Returns a note if the chromaticities (x and y of red, green, blue, white) are not those of Rec.709."""
    if chromaticities is None or np.shape(chromaticities) != (8,):
        return []
    if any(np.allclose(chromaticities, known, atol=_TOLERANCE) for known in (_REC709, _EQUAL_ENERGY)):
        return []
    listed = " ".join(f"{value:.4g}" for value in chromaticities)
    return [
        Sentence(
            "image-primaries-ignored",
            "{name}: its primaries ({primaries}) are not those of Rec.709, but are read as such. Convert it to linear Rec.709",
            name=name,
            primaries=listed,
        )
    ]


def header_notes(data: bytes, name: str) -> list[str]:
    """Returns notes on a Radiance file's header, about its ignored exposure factor and primaries."""
    head = data[: max(data.find(b"\n\n"), 0)].decode("latin-1")
    said: Mapping[str, list[str]] = {
        key: re.findall(rf"(?m)^{key}\s*=\s*(.+)$", head) for key in ("EXPOSURE", "COLORCORR", "PRIMARIES")
    }
    notes: list[str] = []
    for key in ("EXPOSURE", "COLORCORR"):
        factor = np.ones(3)
        for text in said[key]:
            values = _numbers(text)
            factor = factor * values if len(values) in (1, 3) else factor
        if not np.allclose(factor, 1, rtol=1e-3):
            listed = " ".join(f"{value:g}" for value in (factor[:1] if len({*factor}) == 1 else factor))
            notes.append(
                Sentence(
                    "image-scale-ignored",
                    "{name}: its values are {scales} times the radiance ({key}), which is ignored",
                    name=name,
                    scales=listed,
                    key=key,
                )
            )
    if said["PRIMARIES"]:
        notes += primaries_notes(_numbers(said["PRIMARIES"][-1]), name)
    return notes


def _numbers(text: str) -> np.ndarray:
    try:
        return np.array([float(word) for word in text.split()])
    except ValueError:
        return np.zeros(0)
