"""Rayfarm as a Python library: scenes of arrays, dicts and files in; arrays by AOV name out.

given.py     a scene as a program has it -> files in a folder, which is all that the renderer and a farm read
glb.py       a mesh of arrays as a .glb file
image.py     a picture in memory
asked.py     what is asked for by keywords, checked as the command line's options are
here.py      rendering in this process, from pass to pass
on_farm.py   the same on a farm
render.py    render() and progressive(): either of them
shown.py     a widget of a notebook; shown.js is its half in the browser
"""
