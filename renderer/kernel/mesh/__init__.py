"""Kernels over a mesh's vertices and triangles for scene compilation, without a temporary array per step."""
