"""Reader of Mitsuba scenes (Mitsuba 3 and 0.6), in XML.

document.py  parses a file into elements, with references, defaults and includes resolved
values.py    numbers, colours, spectra and transforms
textures.py  textures
bsdfs.py     BSDFs as materials; media.py media inside shapes and around the sensor
meshes.py    meshes of files and analytic shapes; serialized.py Mitsuba's own mesh format
shapes.py    shapes in the world, with their materials and area lights
emitters.py  lights without a surface, and environment light; skies.py the sky and its sun
sensors.py   cameras, the film, the integrator
reader.py    entry point: reads a scene file

Unsupported content causes a warning. Source of the plugins and their defaults: Mitsuba 3's documentation, "Plugin reference".
"""

from renderer.scene.readers.mitsuba.reader import read

__all__ = ["read"]
