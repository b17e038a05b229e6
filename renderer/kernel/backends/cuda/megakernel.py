"""The kernel of a graphics card: each thread renders some samples of one pixel, one path at a time.

The scalar backend's loop over samples (renderer/kernel/backends/scalar/tile.py) runs unchanged on the thread's own film of one
pixel. Its sums are then added to the film with atomic integer additions, whose order has no effect.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.compressed_tree import STACK_DEPTH
from renderer.film import CHANNELS
from renderer.jit import local_floats, subroutine
from renderer.kernel.backends.cuda.atomics import add_atomically
from renderer.kernel.backends.cuda.local_zeros import local_zeros
from renderer.kernel.backends.scalar.picture import trace_picture
from renderer.kernel.backends.scalar.tile import render_tile

__all__ = ["BAD", "COUNTERS", "RAYS", "Job", "render_thread"]

BAD, RAYS = 0, 1  # entries of `Job.counters`: samples left out of the film, rays traced
COUNTERS = 2
_STACK = 2 * STACK_DEPTH
_SUMS = (CHANNELS, 1, 1)
_NO_BAD, _NO_LOG, _NO_RECORDS = (0, 3), (0, 1), (0, 2)
_BAD, _RAYS = np.uintp(BAD), np.uintp(RAYS)


class Job(NamedTuple):
    """The argument of the GPU kernel: the samples of a tile to render, and the arrays to which they are added."""

    scene: Any
    camera: Any
    options: Any
    batch: Any  # renderer/kernel/accumulate.py
    film: Any  # (CHANNELS, h, w) int64, added to; its size is the tile's
    counters: Any  # (COUNTERS,) int64, added to
    pieces: Any  # threads that share the samples of a pixel, at least 1


class _Part(NamedTuple):
    """The samples of one pixel that a GPU thread renders, with the fields of Batch (renderer/kernel/accumulate.py)."""

    x: Any
    y: Any
    first: Any
    count: Any
    origin: Any


class _Output(NamedTuple):
    """The arrays to which a GPU thread writes, with the fields of Output (renderer/kernel/accumulate.py).

    A GPU thread lists no bad samples and records no path, and no samples, so `bad`, `log` and `records` have no rows.
    """

    sums: Any
    bad: Any
    log: Any
    records: Any


@subroutine
def render_thread(job, thread):
    """Renders the samples of one GPU thread, and adds them to the job's film.

    thread: the thread's number, below height * width * pieces, where `pieces` threads share the samples of a pixel.
    """
    film, batch = job.film, job.batch
    width, pixels = film.shape[2], film.shape[1] * film.shape[2]
    place, piece = thread // job.pieces, thread % job.pieces
    share = (batch.count + job.pieces - 1) // job.pieces
    first = piece * share
    count = min(share, batch.count - first)
    if count <= 0:
        return
    stack = local_floats(_STACK)
    sums = local_zeros(np.int64, _SUMS)
    output = _Output(sums, local_zeros(np.int64, _NO_BAD), local_zeros(np.float64, _NO_LOG), local_zeros(np.uint32, _NO_RECORDS))
    part = _Part(batch.x + place % width, batch.y + place // width, batch.first + first, count, batch.origin)
    bad, rays = render_tile(trace_picture, job.scene, stack, job.camera, job.options, part, output)
    for channel in range(CHANNELS):
        value = sums[channel, 0, 0]
        if value != 0:
            add_atomically(film, np.uintp(channel * pixels + place), value)
    if bad > 0:
        add_atomically(job.counters, _BAD, bad)
    add_atomically(job.counters, _RAYS, rays)
