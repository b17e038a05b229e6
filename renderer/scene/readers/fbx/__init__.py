"""Reader of FBX files, binary and text, of all versions that ufbx supports.

layout.py    structures of ufbx's C interface
library.py   access to ufbx, and conversion of its lists to arrays
animation.py animation stacks, and the elements that they animate
meshes.py    triangulation of polygons, one mesh per material
shapes.py    blend shapes and skins
materials.py Lambert, Phong and physically based materials; textures.py their images
lights.py    lights and cameras; targets.py their targets
reader.py    conversion to a scene
"""

from renderer.scene.readers.fbx.reader import read

__all__ = ["read"]
