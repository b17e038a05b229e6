"""Default camera of scenes without one, which frames the whole scene from a three-quarter angle, and what another one misses."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.kernel.camera import axes_of, extent_at_one
from renderer.settings import Vec3, View

__all__ = ["frame", "is_out_of_view"]

FOV = 35.0  # degrees, vertical: about a 55 mm lens on full frame, natural for objects
ASPECT = 3 / 2  # wider pictures show more at the sides, squares stay nearly whole
MARGIN = 1.25  # the scene fills four fifths of the height, or of the width at ASPECT
CENTRING_STEPS = 8  # two or three suffice
SAMPLED = 50_000


def frame(points: npt.NDArray[np.floating], up: Vec3 = (0.0, 1.0, 0.0)) -> View:
    """Returns the view that frames (N, 3) points with room around them, from slightly above and to the right of the front.

    The front is +Z for Y up (glTF's convention) and -Y for Z up (Blender's and CAD's).
    """
    if len(points) > SAMPLED:
        points = points[:: len(points) // SAMPLED + 1]
    points = points.astype(np.float64)
    vertical = np.asarray(up, np.float64) / np.linalg.norm(up)
    front = np.array([0.0, 0.0, 1.0]) if abs(vertical[2]) < 0.9 else np.array([0.0, -1.0, 0.0])
    side = np.cross(vertical, front)
    back = front + 0.62 * side + 0.42 * vertical  # from the scene to the camera
    back /= np.linalg.norm(back)
    right = np.cross(vertical, back)
    right /= np.linalg.norm(right)
    above = np.cross(back, right)

    # For a fixed orientation the nearest eye that sees every point has a closed form on each axis: the points determine the
    # two planes of the frustum, and the eye is on their intersection.
    tall = np.tan(np.radians(FOV / 2)) / MARGIN
    depth = points @ back
    eye_depth, at = -np.inf, []
    for axis, slope in ((right, tall * ASPECT), (above, tall)):
        across = points @ axis
        high, low = (across + slope * depth).max(), (slope * depth - across).max()
        at.append((high - low) / 2)
        eye_depth = max(eye_depth, (high + low) / (2 * slope))
    extent, farthest = np.ptp(points, axis=0).max(), np.abs(points).max()
    size = max(float(extent), 1e-6, 1e-9 * float(farthest))  # of a single point, more than its rounding
    eye_depth = max(eye_depth, depth.max() + 0.05 * size)
    # On the axis with more room, the picture of the points is centred from that eye.
    at = [_centred(points @ axis, 1.0 / (eye_depth - depth), near) for axis, near in zip((right, above), at, strict=True)]
    middle = (depth.max() + depth.min()) / 2
    eye = at[0] * right + at[1] * above + eye_depth * back
    target = at[0] * right + at[1] * above + middle * back
    return View(_vec3(eye), _vec3(target), _vec3(vertical), FOV)


def _centred(across: npt.NDArray[np.float64], scale: npt.NDArray[np.float64], at: float) -> float:
    """Returns the position on an axis from which the projections of points reach equally far to both sides.

    across: positions of the points on the axis, (N,). scale: reciprocals of their depths, (N,). at: a first guess.
    """
    for _ in range(CENTRING_STEPS):  # Newton's method: the extent is piecewise linear
        seen = (across - at) * scale
        first, last = seen.argmin(), seen.argmax()
        at += float((seen[first] + seen[last]) / (scale[first] + scale[last]))
    return at


def is_out_of_view(points: npt.NDArray[np.floating], view: View, aspect: float) -> bool:
    """Returns True if a camera shows nothing between (N, 3) points for certain: all are beyond one edge of its picture.

    aspect: width of the picture by its height.
    """
    if view.projection == "panorama" or view.distortion is not None or not len(points):
        return False
    right, up, back, eye = axes_of(view)
    x, y, z = np.stack([right, up, -back]) @ (np.asarray(points, np.float64) - eye).T
    height = np.full_like(z, view.height) if view.projection == "orthographic" else z * extent_at_one(view)
    across, above = x - view.shift_x * height, y - view.shift_y * height
    beyond = (
        across > height * aspect / 2,
        across < -height * aspect / 2,
        above > height / 2,
        above < -height / 2,
        z <= view.near,
    )
    return any(bool(side.all()) for side in beyond)


def _vec3(v: npt.NDArray[np.float64]) -> Vec3:
    return float(v[0]), float(v[1]), float(v[2])
