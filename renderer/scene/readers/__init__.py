"""Scene file readers, one per format: `read(files, main, description)` fills a SceneDescription or raises SceneError.

by_format.py        selects the reader of a file by the table in renderer/formats.py
file_damage.py      errors in plain words for files that are cut off or have another content than their suffix says
gltf/               glTF 2.0, .gltf and .glb
fbx/                FBX, by ufbx
assimp/             less common formats, by assimp; collada.py Collada, with trimesh where assimp rejects a file
obj.py              Wavefront OBJ: obj_lines.py parses its statements, mtl.py and mtl_maps.py its materials
yaml/               Rayfarm's scene files (docs/scene-format.md), with built-in shapes in shapes.py and metals in metals.py
mitsuba/, pbrt/     scenes of Mitsuba and of pbrt-v4
threemf.py          3MF
tubes.py            curves as tubes, fibres of hair or ribbons; polylines.py how finely fibres are divided
image_baking.py     procedural textures baked to images, for USD and pbrt
trimesh_files.py    formats read by trimesh
"""
