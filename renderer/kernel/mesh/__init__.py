"""Passes over a mesh's vertices and triangles while a scene is compiled: what must not take a temporary array for every step."""
