"""Where a scene is read: files -> description -> compiled scene.

load.py         a folder of untrusted files -> SceneDescription, by the reader of the format
animation/      what moves: keys, clips, and which moment is meant
files.py        the only way by which readers open files; textures.py the same for images
readers/        one file a format
description.py  what every reader gives: meshes, spheres, materials, textures, lights, cameras
studio.py       the light of scenes that have none
compile.py      description -> compiled scene, by geometry.py, material_packing.py (materials, texels), lights.py and the BVH
default_camera.py      a camera for scenes without one
compiled.py     the compiled scene (renderer/arrays/scene.py: the flat arrays that the kernel reads) in one file
scene_equality.py         whether two descriptions compile alike
material.py     the table of a material's parameters, which readers, checks, packing and schema.json follow

To add a format: a reader with `read(files, main, description)`, and its row in renderer/formats.py.
"""
