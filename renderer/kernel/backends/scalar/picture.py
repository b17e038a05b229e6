"""The path tracer for images, one path at a time: multiple importance sampling by the power heuristic."""

from __future__ import annotations

import numpy as np

from renderer.jit import device, template
from renderer.kernel.backends.scalar.path import trace_path
from renderer.kernel.material.material import sample_material
from renderer.kernel.steps.mis import hit_weight, light_weight
from renderer.kernel.steps.state import BsdfSample

__all__ = ["trace_with"]

_ONE = np.float32(1.0)


@device
def _weigh_hit(options, ray, path, last, point, light_pdf):
    return hit_weight(ray.pdf, light_pdf)


@device
def _weigh_light(options, light, scatter_pdf, branches, point):
    return light_weight(light.pdf, scatter_pdf, branches)


@device
def _sample_bsdf(scene, vertex, options, choose, u):
    wi, weight, pdf, eta2 = sample_material(vertex.material, vertex.wo, choose, u)
    return BsdfSample(wi, weight, pdf, eta2, _ONE)


@template
def trace_with(scene, stack, camera, medium_stack, options, log, first, lit):
    """Traces one sample with the same bits as the pool of paths (renderer/kernel/backends/cpu); see `trace_path`.

    lit: whether next-event estimation finds anything.
    """
    return trace_path(scene, stack, camera, medium_stack, options, log, first, lit, _weigh_hit, _weigh_light, _sample_bsdf)
