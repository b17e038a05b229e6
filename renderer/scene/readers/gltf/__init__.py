"""Reader for glTF 2.0 files.

container.py is the file, accessors.py its arrays, nodes.py its hierarchy, reader.py the driver. Geometry: meshes.py,
primitives.py, deform.py, draco.py and instancing.py. Surfaces: materials.py, extensions.py, textures.py and
specular_glossiness.py. Lights and cameras: lights.py and cameras.py. animation.py writes animated values into the JSON that the
other modules read, at the places that pointers.py allows.

Source: Khronos, glTF 2.0 Specification. Content that is not supported gives a warning.
"""

from renderer.scene.readers.gltf.reader import read

__all__ = ["read"]
