""".blend and Alembic files: Blender opens them, in a process of its own that can do little harm, and writes what is read here.

program.py   finds Blender: a program, or a Python that has it as a module
convert.py   has it write a scene of ours, and says what came of it
opening.py   opens a file for this process, or for a confined reader
confined.py  what that process may open, take and reach; a script that becomes it
inside/      what runs in Blender's own Python, and imports nothing of ours
"""
