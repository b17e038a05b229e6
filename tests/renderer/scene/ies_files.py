"""Writes IES profiles for tests, and looks values up in them."""

from __future__ import annotations

import numpy as np

from renderer.jit import entry
from renderer.kernel.light.emission_map import look_up_emission
from renderer.scene.emission_maps import tabulate_emission

__all__ = ["HEADERS", "candela_of", "ies", "looked_up"]

HEADERS = ("", "IESNA91\n", "IESNA:LM-63-1995\n", "IESNA:LM-63-2002\n", "IES:LM-63-2019\n")
_KINDS = {"C": 1, "B": 2, "A": 3}


def ies(vertical, horizontal, candela, kind="C", header=HEADERS[3], tilt="TILT=NONE\n", multiplier=1, ballast=(1, 1)):
    """Returns the bytes of an IES file; all angles are in degrees.

    candela: (h, v), or a function of (all vertical angles, one horizontal angle).
    """
    if callable(candela):
        candela = [candela(np.asarray(vertical, float), h) for h in horizontal]
    lines = [
        header
        + "[TEST] made for a test\n[MANUFAC] nobody\n"
        + tilt
        + f"1 1000 {multiplier} {len(vertical)} {len(horizontal)} {_KINDS[kind]} 2 0 0 0",
        f"{ballast[0]} {ballast[1]} 100",
        " ".join(f"{v:g}" for v in vertical),
        " ".join(f"{v:g}" for v in horizontal),
        *(" ".join(f"{v:.9g}" for v in row) for row in candela),
    ]
    return "\n".join(lines).encode() + b"\n"


@entry
def _look_up(maps, windows, texels, local, found):
    for i in range(len(local)):
        found[i, 0], found[i, 1], found[i, 2] = look_up_emission(
            maps, windows, texels, np.int64(0), (local[i, 0], local[i, 1], local[i, 2])
        )


def looked_up(emission, local):
    """Looks up an emission map by the kernel's function; returns its values (n, 3) in the directions `local` (n, 3).

    Directions are given by their components along the map's axes r, u and f.
    """
    tables = tabulate_emission([emission])
    local = np.ascontiguousarray(local, np.float32)
    found = np.zeros((len(local), 3), np.float32)
    _look_up(*map(read_only, (tables.map, tables.window, tables.texel)), local, found)
    return found


def candela_of(photometry, theta, phi):
    """Returns a profile's intensity in candela at angles theta to its axis and one angle phi about the axis, in degrees."""
    theta, phi = np.radians(np.asarray(theta, float)), np.radians(float(phi))
    local = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    return looked_up(photometry.emission, local)[:, 0]


def read_only(array):
    """Makes the array read-only, as arrays are when the kernel gets them, and returns it."""
    array.flags.writeable = False
    return array
