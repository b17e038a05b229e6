"""One reader a format: `read(files, main, description)` fills a SceneDescription, or raises SceneError with a sentence.

gltf/       glTF 2.0, .gltf and .glb
obj.py      Wavefront OBJ, with mtl.py for its materials
yaml.py     our own scene files (docs/scene-format.md), with shapes.py for what they name and no file holds
other.py    what trimesh reads: Collada, PLY, STL, OFF
"""
