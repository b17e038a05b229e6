"""A path tracer that follows one path at a time, with a selected strategy to find light, or with a deliberate error."""

from __future__ import annotations

from renderer.jit import device, template
from renderer.kernel.backends.scalar.light import has_lights
from renderer.kernel.backends.scalar.path import trace_path
from renderer.kernel.lineage.strategy import sample_direction, weigh_hit, weigh_light
from renderer.kernel.options import LIGHT, MIS

__all__ = ["trace_special_path"]


@device
def _has_lights(scene, options):
    """Returns True if the selected strategy has any lights to sample.

    Strategies without light sampling still sample punctual lights, which rays cannot hit.
    """
    lit = has_lights(scene)
    if options.sampling != MIS and options.sampling != LIGHT:
        lit = len(scene.punctual_kind) > 0
    return lit


@template
def trace_special_path(scene, stack, camera, medium_stack, options, log, first):
    """Traces one sample with the selected strategy or deliberate error. Parameters and result are those of `trace_path`."""
    lit = _has_lights(scene, options)
    return trace_path(scene, stack, camera, medium_stack, options, log, first, lit, weigh_hit, weigh_light, sample_direction)
