"""The path tracer: reads scene files and returns exact sums of radiance samples.

Depends on numpy, numba and files only, not on queues, HTTP or jobs. The packages and modules, in the order of a render:

    confine/  reads untrusted files in a sandboxed child process
    scene/    reads a scene and compiles it into one memory-mapped file
    arrays/   the compiled scene as arrays: written by scene/, read by bvh/ and kernel/
    bvh/      intersects rays with triangles and spheres
    kernel/   scatters, samples and sums light (compiled by Numba)
    film.py   the exact sums: channels, fixed point, sample counts (plain numpy: the service merges films with it)
    image/    image files and tone curves (plain numpy)
    render.py renders a batch or a frame in one process
    precompile.py, shipped_kernels.py
              kernels compiled ahead of time, for container images and wheels

This module imports nothing: `renderer.film` and `renderer.image` work where numba is not installed.
"""

__version__ = "0.2.0"
