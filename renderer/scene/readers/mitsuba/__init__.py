"""Scenes of Mitsuba 3 (and 0.6), in XML.

document.py  the file as elements: references, defaults and includes resolved
values.py    numbers, colours, spectra and transforms
textures.py  what varies over a surface
bsdfs.py     BSDFs as materials; media.py what fills shapes and the world
meshes.py    shapes that are meshes of files or formulas; serialized.py Mitsuba's own file of meshes
shapes.py    shapes placed, with their material and light
emitters.py  lights without a body, and light from all around; skies.py the sky and its sun
sensors.py   cameras, the film, the integrator
reader.py    the parts put together

What ours cannot express is named in a warning. Source of the plugins and their defaults: Mitsuba 3's documentation, "Plugin
reference".
"""

from renderer.scene.readers.mitsuba.reader import read

__all__ = ["read"]
