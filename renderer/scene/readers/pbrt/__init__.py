"""Scenes of pbrt-v4.

statements.py  a file and all that it includes as statements: a directive and its arguments
parameters.py  a statement's parameters by name and type
transforms.py  the current transformation, at the beginning and the end of time
graphics.py    what statements change: transformations, materials, lights, named things; and what they make
spectra.py     spectra and colours as linear Rec.709; observer.py how an eye weighs wavelengths, named_spectra.py metals, glasses
               and lights by name
textures.py    what varies over a surface, by formulas worked out as a picture
materials.py   materials, conductors.py their metals, coats.py what lies over paint and metal, hair.py hair
media.py       what fills shapes and the world, and what light does beneath skin
meshes.py      shapes of triangles and patches, quadrics.py round ones, loop.py Loop's subdivision, curves.py curves as tubes
shapes.py      shapes placed, with their material and light
lights.py      lights without a body, and light from all around; equal_area.py the square pictures of it
cameras.py     cameras, the film, the sampler and the integrator
options.py     options, by which a picture would be another
notes.py       what is not taken over, each with the line where it stands
reader.py      the parts put together

pbrt's world is left-handed. Where its camera does not mirror what it sees, the whole scene is mirrored here, so that the
picture is the same. Source: "pbrt-v4 Input File Format", and Pharr, Jakob and Humphreys, Physically Based Rendering, 4th edition.
"""

from renderer.scene.readers.pbrt.reader import read

__all__ = ["read"]
