"""Cameras of a data set as plain matrices: poses and intrinsics.

A pose is the 4 x 4 matrix from camera to world space. OpenGL's camera looks along -z with y up, as in Blender and NeRF's
transforms.json; OpenCV's looks along +z with y down, as in COLMAP. Pixel positions are continuous from the picture's upper left
corner, so that the first pixel's centre is (0.5, 0.5) and the middle of a picture is (w / 2, h / 2), as in COLMAP and nerfstudio.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SettingsError
from renderer.frames import MAX_FRAMES
from renderer.lens_distortion import COEFFICIENTS, LensDistortion
from renderer.scene.matrices import product
from renderer.settings import View
from renderer.trigonometry import sin_cos
from renderer.variation import Distribution, Form, Variation

__all__ = ["CONVENTIONS", "Cameras", "intrinsics_of", "opencv", "view_of"]

F64 = npt.NDArray[np.float64]

CONVENTIONS = ("opengl", "opencv")
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # between both conventions
_ROTATION = 1e-4  # the largest error of a rotation's products of rows: single precision
_SQUARE = 1e-6  # of a pixel's sides


class _Model(NamedTuple):
    """A camera model of COLMAP: whether it has two focal lengths, and its distortion, with the coefficients in the same order."""

    has_two: bool
    distortion: str = "brown"


_COLMAP = {
    "SIMPLE_PINHOLE": _Model(False),
    "PINHOLE": _Model(True),
    "SIMPLE_RADIAL": _Model(False),
    "RADIAL": _Model(False),
    "OPENCV": _Model(True),
    "FULL_OPENCV": _Model(True),
    "OPENCV_FISHEYE": _Model(True, "fisheye"),
}


@dataclass(frozen=True)
class Cameras:
    """Poses (N, 4, 4), camera to world in OpenGL's convention; if known, the 3 x 3 intrinsics, (width, height) and distortion."""

    poses: F64
    intrinsics: F64 | None = None
    size: tuple[int, int] | None = None
    distortion: LensDistortion | None = None

    @classmethod
    def of(cls, poses: Any, convention: str = "opengl") -> Cameras:
        """Returns the cameras of an array (N, 4, 4) or (4, 4). Raises SettingsError if a matrix is not a rigid pose."""
        if convention not in CONVENTIONS:
            raise SettingsError(f"convention is {convention!r}; it is opengl or opencv")
        if isinstance(poses, Cameras):
            return poses
        try:
            found = np.array(poses, np.float64)
        except (TypeError, ValueError):
            raise SettingsError(
                "cameras is not an array of numbers; give matrices (N, 4, 4) from camera to world space"
            ) from None
        found = found[None] if found.shape == (4, 4) else found
        if found.ndim != 3 or found.shape[1:] != (4, 4):
            raise SettingsError(f"cameras has the shape {found.shape}; give matrices (N, 4, 4) from camera to world space")
        if not len(found):
            raise SettingsError("cameras is empty; give at least one pose")
        for n, pose in enumerate(found):
            if why := _fault(pose):
                raise SettingsError(f"cameras[{n}] {why}")
        return cls(found @ _FLIP if convention == "opencv" else found)

    @classmethod
    def orbit(
        cls,
        count: int,
        radius: float,
        target: Sequence[float] = (0.0, 0.0, 0.0),
        elevation: float = 20.0,
        turns: float = 1.0,
        start: float = 0.0,
        up: Sequence[float] = (0.0, 1.0, 0.0),
    ) -> Cameras:
        """Returns cameras in equal steps on a circle about a target, at which they look.

        elevation: degrees above the target's horizon, less than 90. start: degrees of the first one around `up`.
        """
        if count < 1:
            raise SettingsError(f"orbit has {count} cameras; give at least one")
        if not (math.isfinite(radius) and radius > 0) or not abs(elevation) < 90:
            raise SettingsError("orbit needs a radius above 0, and an elevation between -90 and 90 degrees")
        axis = np.array(up, np.float64)
        if axis.shape != (3,) or not np.linalg.norm(axis) > 0:
            raise SettingsError("orbit's up is a direction of three numbers, not all 0")
        axis = axis / np.linalg.norm(axis)
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side /= np.linalg.norm(side)
        front = np.cross(side, axis)
        angle = math.radians(start) + 2 * math.pi * turns * np.arange(count) / count
        rise = math.radians(elevation)
        around = np.cos(angle)[:, None] * front + np.sin(angle)[:, None] * side
        back = math.cos(rise) * around + math.sin(rise) * axis
        right = np.cross(axis, back)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        poses = np.zeros((count, 4, 4))
        poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = right, np.cross(back, right), back
        poses[:, :3, 3], poses[:, 3, 3] = np.array(target, np.float64) + radius * back, 1.0
        return cls(poses)

    @classmethod
    def sample(
        cls,
        count: int,
        seed: int = 0,
        target: Any = (0.0, 0.0, 0.0),
        position: Any = None,
        radius: Any = 3.0,
        azimuth: Any = MappingProxyType({"uniform": [0.0, 360.0]}),
        elevation: Any = MappingProxyType({"uniform": [0.0, 60.0]}),
        roll: Any = 0.0,
        up: Sequence[float] = (0.0, 1.0, 0.0),
    ) -> Cameras:
        """Returns cameras drawn from distributions by seed; the same on every machine. Each looks at its target.

        Values are constants or distributions (docs/datasets.md). position: from the target, as {"shell": [2, 3]}; in its place
        radius, azimuth about `up` (counter-clockwise from above; for up +Y, 0 is +X and -90 is +Z) and elevation above the
        target's horizon, in degrees. roll: about the line of sight, degrees.
        """
        if not 1 <= count <= MAX_FRAMES:
            raise SettingsError(f"sample has {count} cameras; give 1 to {MAX_FRAMES}")
        axis = np.array(up, np.float64)
        if axis.shape != (3,) or not axis.any():
            raise SettingsError("sample's up is a direction of three numbers, not all 0")
        axis = axis / math.sqrt(float((axis * axis).sum()))
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side = side / math.sqrt(float((side * side).sum()))
        frame = np.stack([np.cross(side, axis), side, axis])
        forms: dict[str, Form] = {"target": "triple", "roll": "number"}
        forms |= {"position": "triple"} if position is not None else dict.fromkeys(("radius", "azimuth", "elevation"), "number")
        given = {
            "target": target,
            "position": position,
            "radius": radius,
            "azimuth": azimuth,
            "elevation": elevation,
            "roll": roll,
        }
        drawn = {name: Distribution.parse(given[name], f"sample.{name}", form) for name, form in forms.items()}
        draws = Variation(seed).draws
        poses = np.zeros((count, 4, 4))
        for n in range(count):
            values: dict[str, Any] = {name: each.draw(draws(n, "camera", name)) for name, each in drawn.items()}
            if position is not None:
                away = np.array(values["position"])
            else:
                flat, rise = _sin_cos(values["azimuth"]), _sin_cos(values["elevation"])
                along = np.array([rise[1] * flat[1], rise[1] * flat[0], rise[0]])
                away = values["radius"] * product(along[None], frame)[0]
            poses[n] = _looking_back(away, np.array(values["target"]), axis, values["roll"], f"sample: camera {n}")
        return cls(poses)

    @classmethod
    def from_transforms(cls, path: str | Path) -> Cameras:
        """Returns the cameras of a transforms.json, of NeRF's, Instant-NGP's or nerfstudio's kind."""
        data = _json(Path(path))
        try:
            poses = [frame["transform_matrix"] for frame in data["frames"]]
        except (KeyError, TypeError):
            raise SettingsError(f"{path} has no frames with a transform_matrix each") from None
        found = cls.of(poses)
        distortion = _distortion_of(data)
        size = (int(data["w"]), int(data["h"])) if "w" in data and "h" in data else None
        if size is None:
            return cls(found.poses, distortion=distortion)
        width, height = size
        if "fl_x" in data:
            x = float(data["fl_x"])
            y = float(data.get("fl_y", x))
        elif "camera_angle_x" in data:
            x = y = width / 2 / math.tan(float(data["camera_angle_x"]) / 2)
        else:
            return cls(found.poses, None, size, distortion)
        center = float(data.get("cx", width / 2)), float(data.get("cy", height / 2))
        return cls(found.poses, np.array([[x, 0, center[0]], [0, y, center[1]], [0, 0, 1.0]]), size, distortion)

    @classmethod
    def from_colmap(cls, folder: str | Path) -> Cameras:
        """Returns the cameras of a COLMAP model in text form: cameras.txt with one camera, and images.txt, by name."""
        cameras, images = _rows(Path(folder) / "cameras.txt"), _rows(Path(folder) / "images.txt")
        if len(cameras) != 1:
            raise SettingsError(f"{folder} has {len(cameras)} cameras; a data set has one")
        _, model, width, height, *numbers = cameras[0]
        if model not in _COLMAP:
            raise SettingsError(f"{folder} has a camera of COLMAP's model {model}; known are {', '.join(_COLMAP)}")
        given = [float(each) for each in numbers]
        x, y, cx, cy = given[:4] if _COLMAP[model].has_two else (given[0], *given[:3])
        rest = tuple(given[4 if _COLMAP[model].has_two else 3 :])
        distortion = LensDistortion(_COLMAP[model].distortion, rest) if rest else None
        poses = []
        for row in sorted((row for row in images if len(row) == 10 and "." in row[9]), key=lambda row: row[9]):
            to_camera = np.eye(4)
            to_camera[:3, :3] = _of_quaternion([float(each) for each in row[1:5]])
            to_camera[:3, 3] = [float(each) for each in row[5:8]]
            poses.append(np.linalg.inv(to_camera))
        found = cls.of(np.array(poses).reshape(-1, 4, 4), "opencv")
        return cls(found.poses, np.array([[x, 0, cx], [0, y, cy], [0, 0, 1.0]]), (int(width), int(height)), distortion)


def _sin_cos(degrees: float) -> tuple[float, float]:
    return sin_cos(math.radians(math.fmod(degrees, 360.0)))


def _looking_back(away: F64, target: F64, up: F64, roll: float, name: str) -> F64:
    """Returns the pose (4, 4) of a camera at target + away that looks at the target. roll: counter-clockwise, degrees."""
    distance = math.sqrt(float((away * away).sum()))
    if not distance > 0:
        raise SettingsError(f"{name} is at its target; give a radius or position away from it")
    back = away / distance
    right = np.cross(up, back)
    if not (right * right).sum() > 1e-12:  # straight above or below: any direction is as good
        right = np.cross(np.eye(3)[np.argmin(np.abs(back))], back)
    right = right / math.sqrt(float((right * right).sum()))
    above = np.cross(back, right)
    sine, cosine = _sin_cos(roll)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1] = cosine * right + sine * above, cosine * above - sine * right
    pose[:3, 2], pose[:3, 3] = back, target + away
    return pose


def opencv(pose: F64) -> F64:
    """Returns the matrix (4, 4) from world to camera space in OpenCV's convention. pose: camera to world in OpenGL's."""
    rotation, place = pose[:3, :3] @ _FLIP[:3, :3], pose[:3, 3]
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation.T, -rotation.T @ place
    return found


def intrinsics_of(intrinsics: Any, fov: float | None, width: int, height: int) -> F64:
    """Returns the 3 x 3 matrix of the intrinsics, given as such or by the vertical field of view in degrees.

    Raises SettingsError if it is not a pinhole with square pixels.
    """
    if intrinsics is None:
        degrees = 50.0 if fov is None else float(fov)
        if not 0.01 <= degrees <= 179.0:
            raise SettingsError(f"fov is {degrees:g}; it is between 0.01 and 179 degrees")
        focal = height / 2 / math.tan(math.radians(degrees) / 2)
        return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    if fov is not None:
        raise SettingsError("intrinsics and fov are both given; give one of them")
    found = np.array(intrinsics, np.float64)
    if found.shape != (3, 3):
        raise SettingsError(f"intrinsics has the shape {found.shape}; it is [[f, 0, cx], [0, f, cy], [0, 0, 1]] in pixels")
    zeros = found[0, 1], found[1, 0], found[2, 0], found[2, 1], found[2, 2] - 1
    if not np.isfinite(found).all() or any(zeros) or not found[0, 0] > 0:
        raise SettingsError("intrinsics is not a pinhole without skew; give [[f, 0, cx], [0, f, cy], [0, 0, 1]] in pixels")
    if abs(found[0, 0] - found[1, 1]) > _SQUARE * found[0, 0]:
        raise SettingsError(f"intrinsics has focal lengths {found[0, 0]:g} and {found[1, 1]:g}; pixels are square, so give one")
    return found


def view_of(pose: F64, intrinsics: F64, width: int, height: int, distortion: LensDistortion | None = None) -> View:
    """Returns the renderer's view of a camera."""
    eye, back, up = pose[:3, 3], pose[:3, 2], pose[:3, 1]
    focal, cx, cy = float(intrinsics[1, 1]), float(intrinsics[0, 2]), float(intrinsics[1, 2])
    return View(
        eye=(float(eye[0]), float(eye[1]), float(eye[2])),
        target=(float(eye[0] - back[0]), float(eye[1] - back[1]), float(eye[2] - back[2])),
        up=(float(up[0]), float(up[1]), float(up[2])),
        fov=math.degrees(2 * math.atan(height / 2 / focal)),
        shift_x=(width / 2 - cx) / height,
        shift_y=(cy - height / 2) / height,
        distortion=distortion,
    )


def _distortion_of(data: Mapping[str, Any]) -> LensDistortion | None:
    """Returns the distortion of a transforms.json; None if all its coefficients are 0.

    Raises SettingsError for a k4 outside a fisheye lens. There it is the coefficient of r^8 of a polynomial (nerfstudio,
    cameras/camera_utils.py, _compute_residual_and_jacobian), where OpenCV's k4 to k6 are a denominator's.
    """
    model = "fisheye" if "FISHEYE" in str(data.get("camera_model", "")).upper() else "brown"
    found = LensDistortion(model, tuple(float(data.get(name, 0.0)) for name in COEFFICIENTS[model]))
    if found.is_rational:
        raise SettingsError("the cameras have a k4, nerfstudio's coefficient of r^8; only k1 to k3, p1 and p2 can be rendered")
    return found if any(found.coefficients) or model == "fisheye" else None


def _fault(pose: F64) -> str:
    """Returns why a matrix is not a rigid pose; empty if it is one."""
    if not np.isfinite(pose).all():
        return "has a number that is not finite"
    if np.abs(pose[3] - (0, 0, 0, 1)).max() > _ROTATION:
        return "has a last row other than 0, 0, 0, 1"
    rotation = pose[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROTATION:
        return "is not a rotation and translation: its axes are not unit vectors at right angles"
    return "" if np.linalg.det(rotation) > 0 else "is a reflection, not a rotation: its determinant is negative"


def _of_quaternion(q: Sequence[float]) -> F64:
    w, x, y, z = np.array(q) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.expanduser().read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise SettingsError(f"{path} is not JSON: {error}") from None
    if not isinstance(data, dict):
        raise SettingsError(f"{path} is not a transforms.json: it does not hold an object")
    return data


def _rows(path: Path) -> list[list[str]]:
    try:
        lines = path.expanduser().read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise SettingsError(f"{path} cannot be read: {error.strerror}") from None
    return [line.split() for line in lines if line.strip() and not line.startswith("#")]
