"""Rayfarm as a Python library: takes scenes as arrays, dicts and files; returns arrays by AOV name.

scene_input.py      converts a program's scene to files in a folder, the only input of the renderer and of a farm
glb.py              a mesh of arrays as a .glb file
image.py            a picture in memory
arguments.py        keyword arguments, checked like the command line's options
local_render.py     rendering in this process, pass by pass
farm_render.py      the same on a farm
render.py           render() and progressive(), in this process or on a farm
notebook_widget.py  a widget of a notebook; notebook_widget.js is its half in the browser
"""
