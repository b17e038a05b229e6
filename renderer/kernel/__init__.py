"""The rendering kernels: scattering, sampling and summation of light. Compiled by Numba.

Float32 and tuples throughout, without CPU-only techniques.

pool/         the path tracer for frames: many paths at once, in stages
integrators/  one path at a time: the path tracer for comparisons, Whitted, ambient occlusion
light/        choosing and sampling lights; environments; point, spot and distant lights
material/     material rows, texture lookups, dispatch to the BSDF models
bsdf/         one scattering model a file
surface/      from a hit to a point with normals, shading frame and UVs
sampling/     counter-based random numbers, square_to_* with square_to_*_pdf, pixel filters
camera.py     pixels to rays        accumulate.py  the entry points: batches of samples into sums
polynomial.py sin, cos, exp, log, pow      vec.py  tuple arithmetic      options.py  settings for the kernel
"""
