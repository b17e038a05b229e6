"""FBX, binary and text, of any version that ufbx reads.

layout.py    the structures of ufbx's C interface
library.py   ufbx itself, and what its lists hold as arrays
animation.py which of a file's things move, and the animation that is shown
meshes.py    polygons as triangles, a mesh for each material
shapes.py    blend shapes and skins
materials.py Lambert, Phong and physically based materials, with textures.py for their pictures
lights.py    lights and cameras; targets.py what they look at
reader.py    all of them as a scene
"""

from renderer.scene.readers.fbx.reader import read

__all__ = ["read"]
