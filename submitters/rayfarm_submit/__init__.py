"""Hooks that send scenes of Maya and Houdini to a farm, and read its pictures in Nuke.

For Python 3.9 and later, without further packages.

farm.py     calls the program `rayfarm`, and the REST API for pictures
maya.py     exports the scene as USD
houdini.py  exports a LOP node's stage as USD
nuke.py     reads a job's frames

Maya, Houdini and Nuke have modules of these names, so the hooks are imported as `from rayfarm_submit import maya`.
"""
