"""The rendering kernels: scattering, sampling and summation of light. Compiled by Numba.

Float32 and tuples throughout, without CPU-only techniques.

steps/        the rules of light transport, one step of a path each, for any backend
backends/     cpu/: many paths at once, in stages; scalar/: one path at a time; cuda/: on graphics cards
lineage/      Whitted's ray tracing, ambient occlusion, alternative strategies to find light
light/        choosing and sampling lights; environments; point, spot and distant lights
material/     material rows, texture lookups, dispatch to the BSDF models
bsdf/         one scattering model per file
medium/       participating media and subsurface walks
surface/      from a hit to a point with normals, shading frame and UVs
sampling/     counter-based random numbers, square_to_* with square_to_*_pdf, pixel filters
camera.py     pixels to rays        accumulate.py  the entry points: batches of samples into sums
path_trace.py the record of one path        options.py  settings for the kernel
polynomial.py sin, cos, exp, log, pow      vec.py  tuple arithmetic
"""
