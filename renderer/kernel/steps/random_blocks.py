"""The blocks of four random numbers (renderer/kernel/sampling/sampler.py) used by each decision of a sample.

Vertex n, counted from 0, uses block 2 n + 1 for its light and block 2 n + 2 for its scattering; block 0 is the camera's. Blocks
of flights and of subsurface walks are in renderer/kernel/medium.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel.sampling.sampler import INDEPENDENT, Stream, draw4
from renderer.wide.values import to_int, u32

__all__ = [
    "draw_caustic",
    "draw_color",
    "draw_kind",
    "draw_light",
    "draw_passing",
    "draw_photon",
    "draw_scattering",
    "draw_time",
    "draw_trial",
]

_PASSING_BLOCKS = np.uint32((1 << 16) - 1)  # mask of the surface's number: paths that pass more surfaces reuse the blocks
_PASSING = np.uint32(1 << 16)  # first block of transparent surfaces; vertices use lower ones
_COLOR = np.uint32(1 << 17)  # first block of dispersive surfaces
_TIME = np.uint32(1 << 18)  # block whose first number is the sample's shutter time
_KIND = np.uint32(1 << 20)  # first block of the kinds of rays that leave vertices
_CAUSTIC = np.uint32(1 << 24)  # first block of light through casters: TRIALS blocks a vertex, of the lamp and of each walk
_TRIALS = np.uint32(13)
_PHOTON = np.uint32(1 << 12 | 1 << 11)  # of a vertex's blocks, the first one of its photon: walks use lower ones
_ONE, _TWO = np.uint32(1), np.uint32(2)


@device
def draw_light(stream, number):
    """Returns a vertex's numbers for light sampling: two for the point, one for the choice. number: count of earlier vertices."""
    return draw4(stream, u32(u32(to_int(number)) * _TWO + _ONE))


@device
def draw_scattering(stream, number):
    """Returns a vertex's numbers for scattering: two for the direction, one for the choice of a lobe, one for roulette."""
    return draw4(stream, u32(u32(to_int(number)) * _TWO + _TWO))


@device
def draw_passing(stream, row):
    """Returns the random number that determines whether a ray passes a surface. row: number of surfaces hit before."""
    return draw4(stream, u32(u32(u32(to_int(row)) & _PASSING_BLOCKS) + _PASSING))[0]


@device
def draw_color(stream, number):
    """Returns the number that chooses a colour channel at a dispersive surface. number: count of earlier vertices."""
    return draw4(stream, u32(u32(to_int(number)) + _COLOR))[0]


@device
def draw_kind(stream, number):
    """Returns the numbers that choose the kinds of the rays of a vertex, the first branch's and the second one's first.

    number: count of earlier vertices.
    """
    return draw4(stream, u32(u32(to_int(number)) + _KIND))


@device
def draw_time(stream):
    """Returns a sample's shutter time, 0 ... 1."""
    return draw4(stream, _TIME)[0]


@device
def draw_caustic(stream, number):
    """Returns a vertex's numbers for a point on a lamp (two), the lamp, and the caster. number: count of earlier vertices."""
    return draw4(stream, u32(u32(u32(to_int(number)) << _TRIALS) + _CAUSTIC))


@device
def draw_trial(stream, number, trial):
    """Returns the numbers of a walk at a vertex, all from its own block. trial: 0 for the first walk.

    Further walks are independent of the first one, so that they estimate the probability of its solution.
    """
    block = u32(u32(u32(u32(to_int(number)) << _TRIALS) + _CAUSTIC) + u32(u32(trial) + _ONE))
    if trial > 0:
        return draw4(Stream(INDEPENDENT, stream.seed, stream.pixel, stream.sample), block)
    return draw4(stream, block)


@device
def draw_photon(stream, number):
    """Returns the eight numbers of a vertex's photon, as two blocks. number: count of earlier vertices."""
    block = u32(u32(u32(u32(to_int(number)) << _TRIALS) + _CAUSTIC) + _PHOTON)
    return draw4(stream, block), draw4(stream, u32(block + _ONE))
