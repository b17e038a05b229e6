"""glTF 2.0: container.py is the file, accessors.py its arrays, reader.py the hierarchy of nodes, and what hangs on it.

meshes.py, primitives.py, deform.py, draco.py and instancing.py have geometry; materials.py, extensions.py, textures.py and
specular_glossiness.py surfaces; lights.py and cameras.py the rest. animation.py writes what moves into the JSON that all of them
read, where pointers.py says that it may.

Source: Khronos, glTF 2.0 Specification. What is read and what is not is said by warnings, never left out in silence.
"""

from renderer.scene.readers.gltf.reader import read

__all__ = ["read"]
