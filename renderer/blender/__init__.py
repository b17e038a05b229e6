"""Reads .blend and Alembic files: runs Blender in a sandboxed process that converts them to Rayfarm's scene format.

program.py   locates Blender: a program, or a Python with Blender as a module
convert.py   runs the conversion and returns its result
opening.py   opens a file for this process, or for a sandboxed reader process
confined.py  the sandbox: a script that restricts itself and then becomes Blender
inside/      scripts that run in Blender's own Python, and import none of Rayfarm's packages
"""
