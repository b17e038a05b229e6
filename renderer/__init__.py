"""The path tracer: scene files in, exact sums of light out.

Knows numpy, numba and files; nothing of queues, HTTP or jobs. The folders, in the order light meets them:

    confine/  where untrusted files are read: a child process that can do little else
    scene/    where a scene is read and compiled into one memory-mapped file
    arrays/   the compiled scene as arrays: what scene/ writes, and bvh/ and kernel/ read
    bvh/      where a ray meets a triangle or a sphere
    kernel/   where light is scattered, sampled and summed (compiled by Numba)
    film.py   the exact sums: channels, fixed point, sample bookkeeping (plain numpy: the service merges with it)
    image/    picture files and tone curves (plain numpy)
    render.py the whole way in one process
    precompile.py, shipped_kernels.py
              kernels that an image of containers brings

This module imports nothing, so that `renderer.film` and `renderer.image` can be used where numba is not installed.
"""

__version__ = "0.2.0"
