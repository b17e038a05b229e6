"""What assimp opens and nothing of ours does: Collada and the long tail of older programs' files.

library.py   assimp itself, and all that it found in a file, copied out of it
animation.py its animations: where nodes are at a moment
materials.py its materials and pictures
reader.py    all of them as a scene
"""

from renderer.scene.readers.assimp.reader import read

__all__ = ["read"]
