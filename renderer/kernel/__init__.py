"""Where light is scattered, sampled and summed. Compiled by Numba; float32 and tuples throughout, no CPU-only trick.

path.py      the integrator: one path from the camera, with next-event estimation and MIS
camera.py    pixels to rays            surface.py   a hit to a point with normals, uv and material
material.py  material dispatch         bsdf/        one scattering model a file
rows.py      names of a material's columns, slots and flags     layers.py  the rarer materials' rows, looked up
normal_map.py  the frame to shade in
light.py     choosing and sampling     environment.py  light from infinitely far, a sun's disk before it
light_tree.py  one of many lights      punctual.py  points, spots and distant lights without a body
sampler.py   counter-based numbers     warp.py      square_to_* beside square_to_*_pdf
polynomial.py  sin, cos, exp, log, pow of our own     vec.py  tuple arithmetic
texture.py   lookups, and stacks of textures     blend.py    how a layer is laid on what is beneath
"""
