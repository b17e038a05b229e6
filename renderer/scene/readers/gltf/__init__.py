"""glTF 2.0: container.py the file, accessors.py its arrays, materials.py surfaces, nodes.py the hierarchy, draco.py one codec.

Source: Khronos, glTF 2.0 Specification. What is read and what is not is said by warnings, never left out in silence.
"""

from renderer.scene.readers.gltf.reader import read

__all__ = ["read"]
