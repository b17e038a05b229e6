"""Reader of the formats that only assimp supports, and of Collada.

library.py   the binding to assimp, which copies its results
animation.py node transforms at a moment
far.py       exact coordinates far from the origin
materials.py materials and images
reader.py    conversion to a scene
"""

from renderer.scene.readers.assimp.reader import read

__all__ = ["read"]
