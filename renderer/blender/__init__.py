"""Reads .blend and Alembic files: runs Blender in a sandboxed process that converts them to our scene format.

program.py   locates Blender: a program, or a Python with Blender as a module
convert.py   runs the conversion and reports its result
opening.py   opens a file for this process, or for a confined reader
confined.py  the sandbox: a script that restricts itself and then becomes Blender
inside/      scripts that run in Blender's own Python, and import none of our packages
"""
