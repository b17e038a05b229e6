"""Reader for formats supported by assimp only: Collada and older or rare ones.

library.py   the binding to assimp, which copies its results
animation.py node transforms at a moment
materials.py materials and images
reader.py    the driver
"""

from renderer.scene.readers.assimp.reader import read

__all__ = ["read"]
