"""Compiled loops over a mesh's vertices and triangles for scene compilation; unlike numpy, they allocate no temporary arrays."""
