"""The formulas of lens distortion (renderer/lens_distortion.py), and their inverses by Newton's method, in float64.

Coordinates are on the plane at distance 1 before the camera, x to the right and y down, as OpenCV has them. Coefficients are a
row from `LensDistortion.row`. The formulas take numbers in kernels, and arrays in Python.
"""

import math

from renderer.jit import device, entry, subroutine

__all__ = ["FISHEYE", "brown_formula", "fisheye_formula", "undistort_points", "undistorted"]

FISHEYE = 1.0  # the number of the model in a row; 0 is Brown and Conrady's
FIRST = 4  # column of the first coefficient
_ITERATIONS = 40
_CLOSE = 1e-13
_LONGEST = 0.5  # step of an iteration
_PI = math.pi


def brown_formula(lens, row, x, y):
    """Returns where a point (x, y, 1) is seen, and the derivatives: (x, y, dx/dx, dx/dy = dy/dx, dy/dy)."""
    k1, k2, p1, p2 = lens[row, FIRST], lens[row, FIRST + 1], lens[row, FIRST + 2], lens[row, FIRST + 3]
    k3, k4, k5, k6 = lens[row, FIRST + 4], lens[row, FIRST + 5], lens[row, FIRST + 6], lens[row, FIRST + 7]
    r2 = x * x + y * y
    over, under = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = over / under
    slope = (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3) - radial * (k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6))) / under
    across = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    mixed = 2.0 * (x * y * slope + p1 * x + p2 * y)
    first, second = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, radial + 2.0 * y * y * slope
    return across, down, first, mixed, second + 6.0 * p1 * y + 2.0 * p2 * x


brown = device(brown_formula)


def fisheye_formula(lens, row, angle):
    """Returns the distance from the middle at which an angle from the line of sight is seen, and its derivative."""
    k1, k2, k3, k4 = lens[row, FIRST], lens[row, FIRST + 1], lens[row, FIRST + 2], lens[row, FIRST + 3]
    t2 = angle * angle
    distance = angle * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    return distance, 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))


fisheye = device(fisheye_formula)


@device
def _sin_cos(angle):
    """Returns sine and cosine of an angle of at most pi, by series at a quarter of it."""
    a = 0.25 * angle
    a2 = a * a
    sine, cosine, term = 0.0, 0.0, 1.0
    for n in range(10):
        cosine += term
        sine += term * a / (2.0 * n + 1.0)
        term = -term * a2 / ((2.0 * n + 1.0) * (2.0 * n + 2.0))
    for _ in range(2):
        sine, cosine = 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine
    return sine, cosine


@device
def _undistorted_brown(lens, row, u, v):
    x, y, off = u, v, 1.0
    for _ in range(_ITERATIONS):
        across, down, a, b, d = brown(lens, row, x, y)
        e, f = u - across, v - down
        off = abs(e) + abs(f)
        determinant = a * d - b * b
        if off <= _CLOSE or determinant == 0.0:
            break
        step_x, step_y = (d * e - b * f) / determinant, (a * f - b * e) / determinant
        length = math.sqrt(step_x * step_x + step_y * step_y)
        share = _LONGEST / length if length > _LONGEST else 1.0
        x, y = x + share * step_x, y + share * step_y
    if not off <= 1e-9:
        return u, v, 1.0, False
    return x, y, 1.0, True


@device
def _undistorted_fisheye(lens, row, u, v):
    distance = math.sqrt(u * u + v * v)
    if distance < 1e-9:
        return u, v, 1.0, True
    angle, off = min(distance, _PI), 1.0
    for _ in range(_ITERATIONS):
        seen, slope = fisheye(lens, row, angle)
        off = abs(distance - seen)
        if off <= _CLOSE or slope == 0.0:
            break
        step = (distance - seen) / slope
        angle = min(max(angle + min(max(step, -_LONGEST), _LONGEST), 0.0), _PI)
    is_found = off <= 1e-9
    sine, cosine = _sin_cos(angle if is_found else min(distance, _PI))
    return u * sine / distance, v * sine / distance, cosine, is_found


@subroutine
def undistorted(lens, row, x, y):
    """Returns (direction x, y, z, whether there is one) that is seen at a film point (x, y) in pixels.

    Where no direction is, it is that of a lens without these coefficients. The direction is not normalised.
    """
    u, v = (x - lens[row, 2]) / lens[row, 1], (y - lens[row, 3]) / lens[row, 1]
    if lens[row, 0] == FISHEYE:
        return _undistorted_fisheye(lens, row, u, v)
    return _undistorted_brown(lens, row, u, v)


@entry
def undistort_points(lens, points, directions):
    """Fills directions (N, 4) with the direction that is seen at each film point (N, 2), and 1 where there is one, else 0."""
    for n in range(len(points)):
        a, b, c, is_there = undistorted(lens, 0, points[n, 0], points[n, 1])
        directions[n, 0], directions[n, 1], directions[n, 2] = a, b, c
        directions[n, 3] = 1.0 if is_there else 0.0
