"""Light linking: which lights illuminate which objects.

A link set lists the objects that its lights illuminate. An object's links are a bit mask: bit k is set if lights of link set k
illuminate the object. Bit 0 is always set: lights of link set 0 illuminate everything.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel.light.light_sample import LightSample
from renderer.wide.values import as_wide, lookup, u32, where, where3, zero_like

__all__ = ["is_linked", "linked_sample"]

_FIRST, _NOTHING, _BIT = np.uint32(0), np.uint32(0), np.uint32(1)


@device
def is_linked(scene, light, number):
    """Returns True if light number `light` illuminates object `number`.

    number: NO_OBJECT for a point in a medium or on the camera, which all lights illuminate; so are objects beyond the table.
    """
    nowhere = number >= np.uint32(len(scene.object_links))
    links = u32(lookup(scene.object_links, where(nowhere, as_wide(_FIRST, number), number)))
    return nowhere | (((links >> u32(lookup(scene.light_link, light))) & _BIT) != _NOTHING)


@device
def linked_sample(scene, choice, light, sample, number):
    """Returns the LightSample, without radiance if the sampled light does not illuminate object `number`.

    choice, light: as for `sample_chosen`, which sampled it. The environment illuminates everything.
    """
    from_far, none = choice < scene.environment_frame[3], zero_like(choice)
    reached = from_far | is_linked(scene, where(from_far, as_wide(_FIRST, choice), light), number)
    radiance = where3(reached, sample.radiance, (none, none, none))
    return LightSample(sample.direction, sample.end, radiance, sample.pdf, sample.alone)
