"""How far light goes in a homogeneous medium before it is scattered or taken: exponentially far. Of one path, or of eight.

Media go by wavelengths, so one channel's distance is sampled, and weighed against the density that all of them have together
(single-sample multiple importance sampling, Veach 1997, 9.2.4). Each is chosen by what the path carries of it: then all that a
path carries never becomes more from flight to flight.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.polynomial import exp, log
from renderer.wide.values import nil, where, where3

__all__ = ["FLIGHT_BLOCK", "Flight", "carried", "flight_distance", "free_flight", "left_after"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
FLIGHT_BLOCK = 1 << 19  # the first block of numbers for flights: those of other things lie below (integrators/transport.py)


class Flight(NamedTuple):
    """How a flight ends."""

    scatters: bool  # in the medium; else it reaches what the ray meets
    distance: float
    throughput: tuple[float, float, float]  # there


@device
def _left(sigma, distance):
    return where(sigma > _ZERO, exp(-sigma * distance), _ONE)  # infinitely far, too


@device
def left_after(sigma_t, distance):
    """What is left of light after so far: Beer's law."""
    return _left(sigma_t[0], distance), _left(sigma_t[1], distance), _left(sigma_t[2], distance)


@device
def flight_distance(sigma_t, throughput, u):
    """How far light flies that nothing is in the way of: infinitely, where the channel that u chooses is not taken.

    sigma_t: what is scattered or absorbed per unit length, rgb.
    """
    red, green, blue = throughput
    at = u[1] * (red + green + blue)
    sigma = where(at < red, sigma_t[0], where(at < red + green, sigma_t[1], sigma_t[2]))
    return where(sigma > _ZERO, -log(_ONE - u[0]) / sigma, _INF)


@device
def carried(sigma_t, sigma_s, throughput, distance, scatters):
    """The throughput after a flight of `flight_distance`, or of less where it reaches a surface before: it does not scatter then.

    sigma_s: what is scattered per unit length, rgb; without any, nothing is left to chance.
    """
    red, green, blue = throughput
    total = red + green + blue
    none = nil(total)
    one = none + _ONE
    left = left_after(sigma_t, distance)
    ends = where3(scatters, sigma_t, (one, one, one))
    density = (red * ends[0] * left[0] + green * ends[1] * left[1] + blue * ends[2] * left[2]) / total
    density = where(vec.maximum(sigma_s) > _ZERO, density, _ONE)
    passed = vec.mul(throughput, where3(scatters, vec.mul(sigma_s, left), left))
    over = (density <= _ZERO) | (total <= _ZERO)  # no number lives on, so that the film is told of it
    return where3(over, (none, none, none), vec.scale(passed, _ONE / density))


@device
def free_flight(sigma_t, sigma_s, throughput, reach, u):
    """A Flight that carries that throughput and has the way `reach` to the next surface, infinite where there is none."""
    distance = flight_distance(sigma_t, throughput, u)
    scatters = (vec.maximum(sigma_s) > _ZERO) & (distance < reach)
    distance = where(scatters, distance, reach)
    return Flight(scatters, distance, carried(sigma_t, sigma_s, throughput, distance, scatters))
