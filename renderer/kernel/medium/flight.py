"""Free flights in homogeneous media: distances sampled exponentially, or by the angle at a lamp; for one path or eight lanes.

Coefficients depend on the wavelength, so a distance is sampled for one channel and weighted by the mixture density of all
channels (single-sample multiple importance sampling, Veach 1997, 9.2.4). The channel is chosen in proportion to the path's
throughput; then the sum of the throughput never grows from flight to flight.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.medium.equiangular import pdf_equiangular, sample_equiangular
from renderer.kernel.polynomial import exp, log
from renderer.wide.values import where, where3, zero_like

__all__ = ["FLIGHT_BLOCK", "Flight", "carried", "flight_distance", "free_flight", "free_flight_by_lamp", "left_after"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
FLIGHT_BLOCK = 1 << 19  # first random number block of flights; lower blocks are in renderer/kernel/steps/random_blocks.py


class Flight(NamedTuple):
    """The end of a path's flight through a medium: its distance, whether the path scatters there, and the throughput there."""

    scatters: bool  # in the medium; else it reaches a surface
    distance: float
    throughput: tuple[float, float, float]  # at the end


@device
def _left(sigma, distance):
    return where(sigma > _ZERO, exp(-sigma * distance), _ONE)  # also for an infinite distance


@device
def left_after(sigma_t, distance):
    """Returns the transmittance, rgb, over a distance in a medium of extinction coefficient sigma_t: Beer's law."""
    return _left(sigma_t[0], distance), _left(sigma_t[1], distance), _left(sigma_t[2], distance)


@device
def flight_distance(sigma_t, throughput, u):
    """Samples the distance that a path flies in a medium if no surface is in the way.

    sigma_t: extinction coefficient per unit length, rgb. u: two numbers in [0, 1); u[1] chooses the colour channel. The distance
    is infinite if that channel's coefficient is 0.
    """
    red, green, blue = throughput
    at = u[1] * (red + green + blue)
    sigma = where(at < red, sigma_t[0], where(at < red + green, sigma_t[1], sigma_t[2]))
    return where(sigma > _ZERO, -log(_ONE - u[0]) / sigma, _INF)


@device
def carried(sigma_t, sigma_s, throughput, distance, scatters):
    """Returns the throughput after a flight of length `distance`, which ends with scattering or at a surface.

    sigma_t, sigma_s: extinction and scattering coefficients per unit length, rgb; if sigma_s is 0, the result is deterministic.
    scatters: whether the flight ends in the medium. The result is 0 if the density or the throughput is not positive.
    """
    left = left_after(sigma_t, distance)
    return _weighed(sigma_s, left, throughput, scatters, _density(sigma_t, left, throughput, scatters))


@device
def _density(sigma_t, left, throughput, scatters):
    """Returns the density of a flight's end, of all channels together: per unit length, or a probability at a surface.

    left: transmittance up to the end, rgb.
    """
    red, green, blue = throughput
    total = red + green + blue
    one = zero_like(total) + _ONE
    ends = where3(scatters, sigma_t, (one, one, one))
    return (red * ends[0] * left[0] + green * ends[1] * left[1] + blue * ends[2] * left[2]) / total


@device
def _weighed(sigma_s, left, throughput, scatters, density):
    red, green, blue = throughput
    total = red + green + blue
    none = zero_like(total)
    density = where(vec.maximum(sigma_s) > _ZERO, density, _ONE)
    passed = vec.mul(throughput, where3(scatters, vec.mul(sigma_s, left), left))
    over = (density <= _ZERO) | (total <= _ZERO)  # NaN propagates, so the film can count it
    return where3(over, (none, none, none), vec.scale(passed, _ONE / density))


@device
def free_flight(sigma_t, sigma_s, throughput, reach, u):
    """Samples the free flight of a path with that throughput; returns a Flight.

    reach: distance to the next surface, infinite if there is none. u: two numbers in [0, 1).
    """
    distance = flight_distance(sigma_t, throughput, u)
    scatters = (vec.maximum(sigma_s) > _ZERO) & (distance < reach)
    distance = where(scatters, distance, reach)
    return Flight(scatters, distance, carried(sigma_t, sigma_s, throughput, distance, scatters))


@device
def free_flight_by_lamp(sigma_t, sigma_s, throughput, reach, u, span, share):
    """Samples a free flight as `free_flight` does, or by the angle at a lamp; returns a Flight.

    A one-sample mixture (Veach 1997, 9.2.4): the weight has the density of both ways to sample the distance. u: three numbers in
    [0, 1). span: the EquiangularSpan of the way to the next surface. share: probability that the distance is sampled by the
    angle, less than 1; 0 gives the Flight of `free_flight`.
    """
    by_angle = u[2] < share
    distance = where(by_angle, sample_equiangular(span, u[0]), flight_distance(sigma_t, throughput, (u[0], u[1])))
    scatters = (vec.maximum(sigma_s) > _ZERO) & (by_angle | (distance < reach))
    distance = where(scatters, distance, reach)
    left = left_after(sigma_t, distance)
    density = _density(sigma_t, left, throughput, scatters) * (_ONE - share)
    density = density + where(scatters, share * pdf_equiangular(span, distance), _ZERO)
    return Flight(scatters, distance, _weighed(sigma_s, left, throughput, scatters, density))
