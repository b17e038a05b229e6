"""Converts the light of terminated paths from their wavelengths to linear Rec.709, in kernels that render spectra."""

from __future__ import annotations

from renderer.jit import never_inline, subroutine
from renderer.kernel.backends.cpu.lists import DONE, eight_rows, pad
from renderer.kernel.backends.cpu.rows import Sample, camera_stream, gather, group_row, scatter
from renderer.kernel.spectrum.light_planes import planes_to_rgb
from renderer.kernel.spectrum.wavelengths import to_rgb
from renderer.kernel.steps.state import PathState, with_radiance

__all__ = ["spectrum_to_rgb"]


@subroutine
def spectrum_to_rgb(scene, pool, lists, options):
    """Converts the radiance of the branches of paths that have terminated, which are on the list DONE."""
    never_inline()
    for k in range(0, pad(lists, DONE), 8):
        rows = eight_rows(lists, DONE, k)
        path, stream = gather(pool, rows, PathState), camera_stream(gather(pool, rows, Sample), options)
        scatter(pool, rows, with_radiance(path, to_rgb(scene.spectrum, stream, path.radiance)))
        if scene.has.by_light is not None:
            planes_to_rgb(scene.spectrum, stream, pool, group_row(pool, rows, options), options)
