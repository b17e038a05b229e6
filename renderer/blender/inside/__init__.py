"""What runs in Blender's own Python: nothing here imports what only ours has, nor is it imported by us.

export.py     is run: opens the file with its scripts off, and writes our scene file beside what that names
untrusted.py  a copy of a .blend whose names lead nowhere but to the files that came with it; reads no Blender
prepare_scene.py   what stands in the scene as it is rendered: modifiers, what is hidden
instances.py  what collections, particles and nodes show, as objects
movie_textures.py     films and sequences of pictures
surfaces.py   what of materials is not taken over
cameras.py, lights.py, world.py   what glTF cannot say: written as our scene file has it
large.py      large meshes, past the glTF exporter; glb.py: the file that it writes, changed
keys.py       values over the frames
"""
