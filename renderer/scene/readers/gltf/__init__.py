"""Reader of glTF 2.0 files.

container.py parses the file, accessors.py reads its arrays, nodes.py its hierarchy; reader.py is the entry point. Geometry:
meshes.py, primitives.py, deform.py, draco.py and instancing.py. Surfaces: materials.py, extensions.py, textures.py and
specular_glossiness.py. Lights and cameras: lights.py and cameras.py. animation.py writes animated values into the JSON that the
other modules read, at the places that pointers.py allows.

Source: Khronos, glTF 2.0 Specification. Unsupported content causes a warning.
"""

from renderer.scene.readers.gltf.reader import read

__all__ = ["read"]
