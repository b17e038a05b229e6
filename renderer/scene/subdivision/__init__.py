"""Subdivision surfaces, of any file format.

catmull_clark.py  one level after Catmull and Clark or Loop, and limit positions
loop.py           Loop's rules
polygons.py       polygons with values at their corners
refine.py         several levels, with the values at corners
meshes.py         subdivides a triangle mesh of which the polygons are known or can be found again

renderer/scene/readers/pbrt/loop.py stays apart: pbrt's weights (Warren's) and its borders differ from OpenSubdiv's, as here.
"""
