"""Reads a Mitsuba scene."""

from __future__ import annotations

from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.mitsuba.bsdfs import Bsdfs
from renderer.scene.readers.mitsuba.document import Document
from renderer.scene.readers.mitsuba.emitters import add_emitter
from renderer.scene.readers.mitsuba.media import Media
from renderer.scene.readers.mitsuba.sensors import add_integrator, add_sensor, note_far_clipping
from renderer.scene.readers.mitsuba.shapes import Shapes
from renderer.scene.readers.mitsuba.textures import Textures
from renderer.scene.readers.mitsuba.unused_properties import unused_notes
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["read"]


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the scene of a Mitsuba file to the description. Raises SceneError if the file is invalid."""
    document = Document(files, main, description)
    shelf = TextureShelf(description, files)
    media = Media(document)
    shapes = Shapes(document, Bsdfs(document, Textures(document, shelf), media, description), description)
    shapes.check_expansion()
    for part in document.scene.children:
        if part.tag == "shape":
            shapes.add(part)
        elif part.tag == "emitter":
            add_emitter(part, document, shelf, description)
        elif part.tag == "sensor":
            add_sensor(part, document, description)
        elif part.tag == "integrator":
            add_integrator(part, document, description)
    if len(document.scene.children_of("integrator")) > 1:
        document.ignore(Sentence("mitsuba-integrators-several", "The scene has more than one integrator: the last one is used"))
    for part in document.scene.children_of("sensor"):
        note_far_clipping(part, document, description)
    media.surround(description)
    for sentence in unused_notes(document.scene, document.ignored):
        document.ignore(sentence)
    document.warn_of_ignored()
