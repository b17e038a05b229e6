"""A data set described by a YAML file, for `rayfarm dataset`."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from rayfarm.datasets.cameras import Cameras
from rayfarm.datasets.create import Dataset, dataset
from renderer.errors import SettingsError

if TYPE_CHECKING:
    from rayfarm.client import Client

__all__ = ["dataset_of_file"]

_CAMERAS = ("orbit", "sample", "matrices", "file", "transforms", "colmap")
_PASSED = (
    "intrinsics",
    "fov",
    "convention",
    "outputs",
    "sinks",
    "categories",
    "picture_format",
    "plane_format",
    "vary",
    "distortion",
    "sink",
)
_KEYS = ("scene", "folder", "cameras", "settings", *_PASSED)


def dataset_of_file(
    path: Path, farm: Client | None = None, watch: Callable[[int, int], None] = lambda done, total: None
) -> Dataset:
    """Renders the data set that a YAML file describes: the arguments of `dataset` by name. Paths are relative to the file.

    cameras has one key: orbit or sample with the arguments of Cameras.orbit or Cameras.sample, matrices, file (.npy), transforms
    or colmap. settings: of the pictures. Raises RayfarmError.
    """
    document = _read(path)
    for name in document:
        if name not in _KEYS:
            near = difflib.get_close_matches(str(name), _KEYS, 1)
            raise SettingsError(f"{path}: {name!r} is not known" + (f"; did you mean {near[0]!r}?" if near else ""))
    for name in ("scene", "folder", "cameras"):
        if name not in document:
            raise SettingsError(f"{path} has no {name}")
    settings: Any = document.get("settings") or {}
    if not isinstance(settings, Mapping):
        raise SettingsError(f"{path}: settings is a mapping, such as {{spp: 64, seed: 1}}")
    base = path.expanduser().resolve().parent
    scene = document["scene"]
    passed = {name: document[name] for name in _PASSED if document.get(name) is not None}
    if passed.get("convention") is not None and not {"matrices", "file"} & set(document["cameras"]):
        raise SettingsError(f"{path}: convention is for cameras given as matrices or file")
    try:
        return dataset(
            base / scene if isinstance(scene, str) else scene,
            _cameras(document["cameras"], base, path),
            folder=base / str(document["folder"]),
            base=base,
            farm=farm,
            watch=watch,
            **passed,
            **settings,
        )
    except TypeError as error:
        raise SettingsError(f"{path}: {error}") from None


def _cameras(given: Any, base: Path, path: Path) -> Any:
    if not isinstance(given, Mapping) or len(given) != 1 or (kind := next(iter(given))) not in _CAMERAS:
        raise SettingsError(f"{path}: cameras has one of the keys {', '.join(_CAMERAS)}")
    value = given[kind]
    if kind in ("orbit", "sample"):
        if not isinstance(value, Mapping):
            raise SettingsError(f"{path}: {kind} is a mapping, such as {{count: 100, radius: 3}}")
        try:
            return Cameras.orbit(**value) if kind == "orbit" else Cameras.sample(**value)
        except TypeError as error:
            raise SettingsError(f"{path}: {str(error).replace('Cameras.', '')}") from None
    if kind == "matrices":
        return value
    if kind == "file":
        try:
            return np.load(base / str(value), allow_pickle=False)
        except (OSError, ValueError) as error:
            raise SettingsError(f"{path}: cameras {value} cannot be read: {error}") from None
    return Cameras.from_transforms(base / str(value)) if kind == "transforms" else Cameras.from_colmap(base / str(value))


def _read(path: Path) -> Mapping[str, Any]:
    try:
        document = yaml.safe_load(path.expanduser().read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path} cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise SettingsError(f"{path} is not YAML: {str(error).splitlines()[0]}") from None
    if not isinstance(document, Mapping):
        raise SettingsError(f"{path} does not describe a data set: it is not a mapping")
    return document
