"""The features of a scene that decide its kernel edition: features that a scene lacks are not compiled for it."""

from __future__ import annotations

from typing import Any, NamedTuple

__all__ = ["EDITIONS", "EVERYTHING", "Has"]


class Has(NamedTuple):
    """The features of a scene: each True, or None if the scene lacks it.

    None has a type of its own: code under `if scene.has.textures is not None` is pruned from a kernel whose scenes have no
    textures (renderer/prune_absent_features.py), which saves compile time and registers.
    """

    textures: Any  # and what goes with them: normal maps, vertex colours, alpha, and what not every ray meets
    lights: Any  # without a body, or so many that a tree chooses among them
    layers: Any  # materials of many properties, what they absorb, and how they spread colours
    instances: Any
    motion: Any  # while the shutter is open: of the camera, or of anything else
    media: Any  # that scatter, or are bounded by no surface; and what goes on beneath some


# From what compiles and runs fastest to what does all. One for every set of parts would be 64, each compiled when it is first
# wanted, and somebody waits for each.
EDITIONS = {
    "plain": Has(None, None, None, None, None, None),
    "full": Has(True, True, True, True, None, None),
    "moving": Has(True, True, True, True, True, None),
    "media": Has(True, True, True, True, None, True),
    "moving-media": Has(True, True, True, True, True, True),
}
EVERYTHING = EDITIONS["full"]  # of what stands still
