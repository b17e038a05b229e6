"""Displaces meshes by the height textures of their materials, when a scene is compiled.

apply.py    finds what is displaced, and shares the budget of triangles out
dicing.py   splits triangles until their edges are short
lengths.py  measures edges on the screen of the scene's camera, or relative to their object
surface.py  moves the vertices of a diced mesh, and computes its normals
heights.py  looks heights up in a texture

All arithmetic is of single IEEE operations in a fixed order, so the result has the same bits on every host.
"""
