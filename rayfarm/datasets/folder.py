"""The folder of a data set: dataset.json describes it, manifest.jsonl has a line for each view that is complete."""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rayfarm.output_files import write
from renderer.errors import SettingsError

__all__ = ["DESCRIPTION", "JOBS", "MANIFEST", "Description", "Folder", "Views", "plane_bytes", "read_plane", "view_name"]

Description = dict[str, Any]  # dataset.json
Views = list[dict[str, Any]]  # lines of the manifest

DESCRIPTION, MANIFEST, JOBS = "dataset.json", "manifest.jsonl", "jobs.json"
_AXES = ("X", "Y", "Z")


def view_name(number: int) -> str:
    """Returns the name of a view's files, without the suffix."""
    return f"{number:06}"


class Folder:
    """A data set's folder. Files are written atomically; a view counts once its line is in the manifest."""

    def __init__(self, path: Path, identity: str) -> None:
        """Opens or makes the folder. Raises SettingsError if it holds another data set."""
        self.path, self.identity = path, identity
        path.mkdir(parents=True, exist_ok=True)
        known = self._read(DESCRIPTION)
        if known is not None and known.get("identity") != identity:
            raise SettingsError(f"{path} holds another data set; name a new folder, or delete this one")
        if known is None and (path / MANIFEST).exists():
            raise SettingsError(f"{path} has a {MANIFEST} but no {DESCRIPTION}; name a new folder")
        self.views = self._complete_views()

    def describe(self, description: dict[str, Any]) -> None:
        """Writes dataset.json."""
        write(self.path / DESCRIPTION, json.dumps(description, indent=1).encode())

    def jobs(self, farm: str) -> dict[str, list[int]]:
        """Returns the jobs that a farm was given for this folder, with their views."""
        known = self._read(JOBS) or {}
        return known["jobs"] if known.get("farm") == farm else {}

    def remember_jobs(self, farm: str, jobs: dict[str, list[int]]) -> None:
        """Stores the jobs that a farm was given, so that a later run continues with them."""
        write(self.path / JOBS, json.dumps({"farm": farm, "jobs": jobs}).encode())

    def write_file(self, output: str, number: int, suffix: str, data: bytes) -> dict[str, str]:
        """Writes one file of a view; returns its entry of the manifest."""
        place = self.path / output
        place.mkdir(exist_ok=True)
        name = f"{output}/{view_name(number)}.{suffix}"
        write(self.path / name, data)
        return {"path": name, "sha256": hashlib.sha256(data).hexdigest()}

    def add_view(self, line: dict[str, Any]) -> None:
        """Appends a complete view to the manifest."""
        with (self.path / MANIFEST).open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        self.views[int(line["view"])] = line

    def _complete_views(self) -> dict[int, dict[str, Any]]:
        """Returns the manifest's views whose files exist. A line that was cut off by a crash is dropped."""
        found: dict[int, dict[str, Any]] = {}
        path = self.path / MANIFEST
        if not path.exists():
            return found
        text = path.read_text(encoding="utf-8")
        lines = text.split("\n")
        for line in lines[:-1]:
            try:
                view = json.loads(line)
            except ValueError:
                continue
            if all((self.path / file["path"]).is_file() for file in view["files"].values()):
                found[int(view["view"])] = view
        kept = "".join(json.dumps(view) + "\n" for view in found.values())
        if kept != text:
            write(path, kept.encode())
        return found

    def _read(self, name: str) -> dict[str, Any] | None:
        path = self.path / name
        if not path.exists():
            return None
        try:
            data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise SettingsError(f"{path} is not JSON; name a new folder") from None
        return data


def plane_bytes(plane: npt.NDArray[Any], format: str) -> bytes:
    """Returns a plane (h, w) or (h, w, k) as a file: npy, or exr with float32 channels (ids are exact below 2^24)."""
    if format == "npy":
        out = io.BytesIO()
        np.save(out, plane, allow_pickle=False)
        return out.getvalue()
    from renderer.image.encode import encode_channels

    channels = plane[..., None] if plane.ndim == 2 else plane
    return encode_channels(channels.astype(np.float32), ("Y",) if channels.shape[2] == 1 else _AXES[: channels.shape[2]])


def read_plane(path: Path) -> npt.NDArray[Any]:
    """Returns the plane (h, w) or (h, w, k) of a file from `plane_bytes`."""
    if path.suffix == ".npy":
        found: npt.NDArray[Any] = np.load(path, allow_pickle=False)
        return found
    from renderer.image.read import read

    pixels = read(path.read_bytes(), path.name)
    return pixels[..., 0] if pixels.ndim == 3 and pixels.shape[2] == 1 else pixels
