"""Reader of pbrt-v4 scenes.

statements.py  splits a file and its includes into statements: a directive and its arguments
parameters.py  a statement's parameters by name and type
transforms.py  transformations at the start and end times
graphics.py    the graphics state, and the objects that statements add to the scene
spectra.py     spectra and colours as linear Rec.709; observer.py colour matching functions; named_spectra.py metals, glasses
   and lights
textures.py    textures; formulas are baked to images
materials.py   materials; conductors.py metals, coats.py coated diffuse and coated metal, hair.py hair
media.py       media inside shapes and in the world, and subsurface scattering
meshes.py      triangles and bilinear patches; quadrics.py quadrics, loop.py Loop subdivision, curves.py curves as tubes
shapes.py      shapes in the world, with their materials and area lights
lights.py      lights without a surface, and environment light; equal_area.py equal-area environment images
cameras.py     cameras, the film, the sampler and the integrator
options.py     options that would change the image
notes.py       notes about unsupported content, with line numbers
reader.py      entry point: reads a scene file

pbrt's world is left-handed. Unless the camera already mirrors the view, the whole scene is mirrored when it is read, so that
the image is the same. Source: "pbrt-v4 Input File Format", and Pharr, Jakob and Humphreys, Physically Based Rendering, 4th
edition.
"""

from renderer.scene.readers.pbrt.reader import read

__all__ = ["read"]
