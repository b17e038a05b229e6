"""Where light is scattered, sampled and summed. Compiled by Numba; float32 and tuples throughout, no CPU-only trick.

pool/         the path tracer for pictures: many paths at once, in stages
integrators/  one path after the other: what comparisons ask of a path tracer, Whitted, ambient occlusion
light/        choosing a light and sampling it; light from infinitely far; points, spots and suns
material/     a material's row, its textures looked up, the dispatch to the models
bsdf/         one scattering model a file
surface/      a hit to a point with a normal, a frame to shade in and UVs
sampling/     counter-based numbers, square_to_* beside square_to_*_pdf, pixel filters
camera.py     pixels to rays        accumulate.py  the entry points: batches of samples into sums
polynomial.py sin, cos, exp, log, pow of our own      vec.py  tuple arithmetic      options.py  settings for the kernel
"""
