"""Where a ray meets a triangle or a sphere.

layout.py    the arrays of a built tree
build.py     the builder (binned SAH in split.py, first over clusters.py); collapse.py makes its binary tree 8-wide
instances.py trees shown many times
traverse.py  closest hit and any hit; packet.py tests eight triangles or eight spheres at once;
             prefetch.py asks for memory before it is read
simd.py      eight lanes as a type for kernels: the one place with instructions for CPUs only
"""
