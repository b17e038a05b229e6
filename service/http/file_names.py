"""File names for downloaded pictures, derived from the scene's name: `CesiumMilkTruck-128spp.exr`."""

from __future__ import annotations

import re
import unicodedata
from urllib.parse import quote

from renderer.frames import frame_name
from service.store.models import Job

__all__ = ["content_disposition", "picture_name", "title_of"]

MAX_TITLE_LENGTH = 100  # characters of a title: file systems allow 255 bytes, and a character may take four
SUFFIX = re.compile(r"\.[A-Za-z]\w{0,7}$")
ALLOWED_PUNCTUATION = "._-+()"  # in addition to letters and digits


def title_of(job: Job) -> str:
    """Returns the job's name in a form suited to file names: letters, digits and a few marks, without the scene file's suffix."""
    plain = unicodedata.normalize("NFC", SUFFIX.sub("", job.name))
    clean = "".join(c if c in ALLOWED_PUNCTUATION or unicodedata.category(c)[0] in "LNM" else "-" for c in plain)
    return re.sub("-{2,}", "-", clean).strip("-.")[:MAX_TITLE_LENGTH] or job.id


def picture_name(job: Job, frame: float, samples: int, kind: str, extension: str) -> str:
    """Returns the file name for a downloaded picture, which includes its mean number of samples per pixel.

    samples: sum over all pixels. kind: name of an AOV or similar; empty for the colour.
    """
    settings = job.settings or {}
    spp = samples // max(int(settings.get("width", 1)) * int(settings.get("height", 1)), 1)
    parts = [title_of(job), frame_name("####", frame) if job.shot is not None else "", f"{spp}spp", kind]
    return f"{'-'.join(filter(None, parts))}.{extension}"


def content_disposition(name: str, disposition: str = "inline") -> str:
    """Returns a Content-Disposition header: with an ASCII name, and also the encoded name of RFC 6266 if it is not ASCII."""
    ascii_name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().replace('"', "")
    plain = f'{disposition}; filename="{ascii_name}"'
    return plain if ascii_name == name else f"{plain}; filename*=UTF-8''{quote(name)}"
