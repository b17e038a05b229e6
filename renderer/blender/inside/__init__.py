"""What runs in Blender's own Python: nothing here imports what only ours has, nor is it imported by us.

export.py     is run: opens the file with its scripts off, and writes our scene file beside what that names
untrusted.py  a copy of a .blend whose names lead nowhere but to the files that came with it; reads no Blender
prepared.py   what stands in the scene as it is rendered: modifiers, instances, what is hidden
surfaces.py   what of materials is not taken over
cameras.py, lights.py, world.py   what glTF cannot say: written as our scene file has it
keys.py       values over the frames
"""
