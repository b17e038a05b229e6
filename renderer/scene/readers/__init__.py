"""One reader a format: `read(files, main, description)` fills a SceneDescription, or raises SceneError with a sentence.

by_format.py which of them reads a file, by the table in renderer/formats.py
gltf/       glTF 2.0, .gltf and .glb
fbx/        FBX, by ufbx
assimp/     the long tail, by assimp; collada.py Collada, of which trimesh reads what assimp refuses
obj.py      Wavefront OBJ: obj_lines.py has its statements, mtl.py and mtl_maps.py its materials
yaml/       our own scene files (docs/scene-format.md), with shapes.py for what they name and no file holds, and metals.py
mitsuba/    scenes of Mitsuba; pbrt/ of pbrt-v4
threemf.py  3MF
tubes.py    curves as tubes, of USD and pbrt
image_baking.py    what is worked out as a picture, of USD and pbrt
trimesh_files.py    what trimesh reads: PLY, STL, OFF
"""
