"""Builds bounding volume hierarchies and intersects rays with triangles and spheres.

layout.py    the arrays of a built tree
build.py     the builder (binned SAH in split.py, clusters.py for the top levels); collapse.py makes its binary tree 8-wide
instances.py trees with many instances
traverse.py  closest hit and any hit; packet.py tests eight triangles or eight spheres at once; prefetch.py prefetches memory
simd.py      eight lanes as a type for kernels: the only module with CPU-only instructions
"""
