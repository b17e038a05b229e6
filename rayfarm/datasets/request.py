"""The arguments of dataset(), checked and completed."""

from __future__ import annotations

import difflib
import hashlib
import importlib.util
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from rayfarm.datasets.annotate import FLOWS, OUTPUTS
from rayfarm.datasets.cameras import F64, Cameras, intrinsics_of, view_of
from rayfarm.library.arguments import RenderArguments, parse_arguments
from rayfarm.scene_files import files_to_upload
from renderer.errors import SettingsError
from renderer.formats import FORMATS
from renderer.lens_distortion import LensDistortion
from renderer.settings import View
from renderer.variation import Variation

__all__ = ["SINKS", "Request", "check_names", "parse_request", "scene_files"]

PICTURE_FORMATS = ("png", "exr", "jpg")
PLANE_FORMATS = ("npy", "exr")
SINKS = ("transforms", "coco", "webdataset", "hdf5", "bop", "parquet")
_PACKAGES = {"hdf5": "h5py", "parquet": "pyarrow"}  # of sinks, in the extra `datasets`
_OF_DATASET = ("camera", "frame", "aovs", "denoise")  # settings of a picture that a data set decides itself
_SIZE = (512, 512)
_SCENE_FILES = tuple(format.suffix for format in FORMATS if format.reader == "yaml")


@dataclass(frozen=True)
class Request:
    """A data set as requested: its views, what is written of each, and how it is rendered.

    identity: hash of everything that determines the files; a folder holds one data set.
    """

    poses: F64  # (N, 4, 4), camera to world in OpenGL's convention
    intrinsics: F64  # (3, 3)
    distortion: LensDistortion | None
    width: int
    height: int
    views: list[View]
    outputs: tuple[str, ...]
    sinks: tuple[str, ...]
    categories: Mapping[str, str] | None
    picture_format: str
    plane_format: str
    arguments: RenderArguments
    vary: dict[str, Any] | None
    settings: dict[str, Any]
    identity: str


def parse_request(
    scene: Path,
    cameras: Any,
    intrinsics: Any,
    fov: float | None,
    convention: str,
    outputs: Iterable[str],
    sinks: Iterable[str],
    categories: Mapping[str, str] | None,
    picture_format: str,
    plane_format: str,
    vary: Mapping[str, Any] | Literal[False] | None,
    distortion: Any,
    settings: Mapping[str, Any],
) -> Request:
    """Returns the checked request. scene: its main file. vary: None for the scene file's own, False for none.

    Raises SettingsError with one sentence, or TypeError for a keyword.
    """
    found = Cameras.of(cameras, convention)
    wanted, forms = check_names("outputs", outputs, OUTPUTS), check_names("sinks", sinks, SINKS)
    if not wanted:
        raise SettingsError(f"outputs is empty; known are {', '.join(OUTPUTS)}")
    if "coco" in forms and not {"boxes", "masks"} & {*wanted}:
        raise SettingsError("the sink coco needs boxes or masks among outputs")
    if "bop" in forms and "masks" not in wanted:
        raise SettingsError("the sink bop needs masks among outputs")
    for sink, package in _PACKAGES.items():
        if sink in forms and importlib.util.find_spec(package) is None:
            raise SettingsError(f'the sink {sink} needs the package {package}: pip install "rayfarm[datasets]"')
    if "transforms" in forms and "color" not in wanted:
        raise SettingsError("the sink transforms needs color among outputs")
    check_names("picture_format", [picture_format], PICTURE_FORMATS)
    check_names("plane_format", [plane_format], PLANE_FORMATS)
    for name in _OF_DATASET:
        if settings.get(name) is not None:
            raise SettingsError(f"{name} is for a single picture; a data set has cameras and outputs")
    varying = _vary(_vary_of_scene(scene) if vary is None else vary or None, wanted)
    given = dict(settings)
    width, height = given.get("width"), given.get("height")
    if (width is None) != (height is None):
        raise SettingsError("width and height go together: give both")
    width, height = (width, height) if width is not None and height is not None else found.size or _SIZE
    given |= {"width": int(width), "height": int(height)}
    arguments = parse_arguments(given)
    if fov is None and intrinsics is None:
        intrinsics = found.intrinsics
    if found.intrinsics is not None and found.size not in (None, (int(width), int(height))) and intrinsics is found.intrinsics:
        raise SettingsError(f"the cameras are of pictures of {found.size}; give intrinsics or fov for another size")
    matrix = intrinsics_of(intrinsics, fov, int(width), int(height))
    lens = LensDistortion.parse(distortion) or found.distortion
    views = [view_of(pose, matrix, int(width), int(height), lens) for pose in found.poses]
    if lens is not None:
        _check_lens(views[0], int(width), int(height), forms)
    plain = {name: _plain(value) for name, value in sorted(given.items()) if value is not None}
    named = dict(categories) if categories is not None else None
    of: list[Any] = [found.poses.tolist(), matrix.tolist(), wanted, named, picture_format, plane_format]
    of += [{name: value for name, value in plain.items() if name not in ("threads", "device")}, _hashes(scene, varying)]
    of += [varying] if varying is not None else []
    of += [lens.to_json()] if lens is not None else []
    identity = hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()
    return Request(
        *(found.poses, matrix, lens, int(width), int(height), views, wanted, forms, named, picture_format, plane_format),
        *(arguments, varying, plain, identity),
    )


def _check_lens(view: View, width: int, height: int, sinks: Sequence[str]) -> None:
    """Raises SettingsError if a distorted picture's border shows no direction, or a sink cannot say the distortion."""
    assert view.distortion is not None
    from renderer.vectors import border_angles

    if "bop" in sinks:
        raise SettingsError("the sink bop has no lens distortion; leave out one of them")
    if "transforms" in sinks and view.distortion.is_rational:
        raise SettingsError(
            "the sink transforms has no k4, k5 and k6 of the model brown: readers take its k4 for a coefficient of r^8; leave "
            "out one of them"
        )
    if None in border_angles(view, width, height):
        raise SettingsError(
            "distortion: parts of the picture show nothing, as the coefficients fold back there; reduce the picture or them"
        )


def _vary_of_scene(scene: Path) -> Any:
    """Returns the variation that a scene file of Rayfarm's own has; None for other files. Reading the scene reports faults."""
    if scene.suffix.lower() not in _SCENE_FILES or not scene.is_file():
        return None
    try:
        document = yaml.safe_load(scene.read_bytes())
    except (yaml.YAMLError, ValueError, RecursionError):
        return None
    return document.get("vary") if isinstance(document, dict) else None


def _vary(given: Mapping[str, Any] | None, outputs: Sequence[str]) -> dict[str, Any] | None:
    """Returns a checked variation as JSON data."""
    if given is None:
        return None
    if Variation.parse(given).every == 1 and any(name in FLOWS for name in outputs):
        raise SettingsError("each view varies, so there is no flow from one to the next; set vary.every, or leave out the flow")
    found: dict[str, Any] = _json(given)
    return found


def _json(value: Any) -> Any:
    """Returns nested mappings and sequences as dicts and lists."""
    if isinstance(value, Mapping):
        return {name: _json(each) for name, each in value.items()}
    return [_json(each) for each in value] if isinstance(value, list | tuple) else _plain(value)


def check_names(what: str, given: Iterable[str], known: Sequence[str]) -> tuple[str, ...]:
    """Returns the names once each, in the order of `known`. Raises SettingsError for an unknown one."""
    names = [given] if isinstance(given, str) else list(given)
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, 1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(known)}"
            raise SettingsError(f"{what} has {name!r}, which is not known{hint}")
    return tuple(name for name in known if name in names)


def _plain(value: Any) -> Any:
    """Returns a setting as JSON data."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return hashlib.sha256(value.expanduser().read_bytes()).hexdigest()
    return list(value) if isinstance(value, tuple | list) else value


def scene_files(scene: Path, vary: Mapping[str, Any] | None) -> dict[str, Path]:
    """Returns the files of a scene by name, including the environment images that a variation names."""
    found = dict(files_to_upload(scene))
    light = None if vary is None else Variation.parse(vary).environment.get("light")
    for value in light.values if light is not None else ():
        path = scene.parent / str(value)
        if scene.is_file() and path.is_file() and path.resolve().is_relative_to(scene.parent.resolve()):
            found.setdefault(path.relative_to(scene.parent).as_posix(), path)
    return found


def _hashes(scene: Path, vary: Mapping[str, Any] | None) -> dict[str, str]:
    """Returns the SHA-256 of each of the scene's files, by its name in the scene."""
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in scene_files(scene, vary).items()}
