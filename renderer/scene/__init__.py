"""Reads and compiles scenes: files -> description -> compiled scene.

load.py            a folder of untrusted files -> SceneDescription, by the reader of the file's format
animation/         keys, clips, and the time of a frame
files.py           the only way by which readers open files; textures.py: the same for images
readers/           one file per format
description.py     the result of every reader: meshes, spheres, materials, textures, lights, cameras
studio.py          the lighting of scenes without lights
compile.py         description -> compiled scene, by geometry.py, material_packing.py (materials, texels), lights.py and the BVH
default_camera.py  a camera for scenes without one; room_camera.py: the one of a room; standing.py: what stands on a floor
compiled.py        stores the compiled scene (renderer/arrays/scene.py: the flat arrays that the kernel reads) in one file
scene_equality.py  compares whether two descriptions compile to the same scene
material.py        the table of a material's parameters, used by readers, checks, packing and schema.json

To add a format: a reader with `read(files, main, description)`, and its row in renderer/formats.py.
"""
