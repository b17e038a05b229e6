"""Sizes of the comparison's scenes and pictures, and the selection of lines.

There are full sizes, and small ones for a check that every row works.
"""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["FULL", "QUICK", "Sizes", "begins"]


def begins(name: str, line: str) -> bool:
    """Returns whether the name of a line equals `name`, or begins with `name` and a comma."""
    return f"{line}, ".startswith(f"{name}, ")


@dataclass(frozen=True)
class Sizes:
    """Sizes of scenes and pictures. picture: width and height in pixels. reference_spp: samples per pixel of reference pictures.

    only: names of lines, or their beginnings up to a comma; empty for all. It does not affect cached reference pictures.
    """

    rounds: int
    picture: int
    spp: int
    error_picture: int
    error_spp: int
    reference_spp: int
    small_mesh: int  # triangle count
    large_mesh: int
    texture: int  # width in texels
    lights: int
    rays: int
    ready: tuple[int, ...]  # triangle count of each file
    triangles: tuple[int, ...]  # the five scaling curves
    many_lights: tuple[int, ...]
    pixels: tuple[int, ...]  # width of the picture
    samples: tuple[int, ...]
    depths: tuple[int, ...]
    scaling_spp: int
    only: tuple[str, ...] = field(default=(), repr=False)

    def wants(self, name: str) -> bool:
        """Returns whether a line was requested.

        name: the line's name, or the common beginning of a group; for a group, one requested line suffices.
        """
        return not self.only or any(begins(name, wanted) or begins(wanted, name) for wanted in self.only)


FULL = Sizes(
    rounds=5,
    picture=512,
    spp=64,
    error_picture=256,
    error_spp=64,
    reference_spp=4096,
    small_mesh=70_000,
    large_mesh=1_000_000,
    texture=1024,
    lights=1000,
    rays=1_000_000,
    ready=(1_000_000,),
    triangles=(1_000, 10_000, 100_000, 1_000_000, 10_000_000),
    many_lights=(1, 10, 100, 1_000, 10_000, 100_000),
    pixels=(64, 128, 256, 512, 1024),
    samples=(4, 16, 64, 256),
    depths=(1, 2, 4, 8, 16, 32, 64),
    scaling_spp=32,
)
QUICK = Sizes(
    rounds=1,
    picture=64,
    spp=16,
    error_picture=48,
    error_spp=16,
    reference_spp=256,
    small_mesh=5_000,
    large_mesh=20_000,
    texture=64,
    lights=50,
    rays=50_000,
    ready=(20_000,),
    triangles=(1_000, 10_000),
    many_lights=(1, 100),
    pixels=(32, 64),
    samples=(4, 16),
    depths=(1, 8),
    scaling_spp=8,
)
