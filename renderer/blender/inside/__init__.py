"""Scripts that run in Blender's own Python. They import none of Rayfarm's packages, and are not imported by them.

export.py           the main script: opens the file with its scripts off, and writes a scene file and the files it refers to
untrusted.py        copies a .blend and restricts all paths in it to the uploaded files; does not need Blender
prepare_scene.py    prepares the scene as rendered: modifiers, visibility
instances.py        converts instances of collections, particles and nodes to objects
movie_textures.py   replaces movies and image sequences by still images
surfaces.py         adds notes on material features that are ignored
cameras.py, lights.py, world.py   convert objects that glTF cannot represent to Rayfarm's scene format
large.py            bypasses the glTF exporter for large meshes; glb.py: edits the file that the exporter wrote
keys.py             values sampled over the frames
"""
