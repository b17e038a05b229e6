"""Rejects files that would expand until memory runs out, by references or compression, before assimp opens them."""

from __future__ import annotations

import io
import zipfile
from pathlib import PurePosixPath
from xml.etree import ElementTree

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.readers.expansion_limits import collada_nodes, x3d_nodes
from renderer.scene.readers.xml import refuse_entities
from renderer.sentences import Sentence
from renderer.zips import DAMAGED, is_bomb

__all__ = ["refuse_expanding_files"]

_XML = (".dae", ".x3d", ".xgl", ".amf", ".irrmesh")


def refuse_expanding_files(data: bytes, main: str) -> None:
    """Raises SceneError if a file declares XML entities, has too many nested references, or is a zip bomb."""
    suffix = PurePosixPath(main).suffix.lower()
    if suffix in _XML:
        refuse_entities(data, main, doctype_too=False)
    if suffix == ".x3d":
        try:
            x3d_nodes(ElementTree.fromstring(data), main)
        except ElementTree.ParseError:
            return  # assimp reports the error
    if suffix == ".zae":
        _check_package(data, main)


def _check_package(data: bytes, main: str) -> None:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as package:
            for entry in package.infolist():
                if is_bomb(entry.file_size, entry.compress_size):
                    raise SceneError(
                        Sentence(
                            "archive-part-zip-bomb",
                            "{file}: its part {part} unpacks to many times its size, as zip bombs do; pack it again",
                            file=main,
                            part=entry.filename[:120],
                        )
                    )
                if entry.filename.lower().endswith(".dae"):
                    inside = package.read(entry)
                    refuse_entities(inside, main, doctype_too=False)
                    collada_nodes(ElementTree.fromstring(inside), main)
    except ElementTree.ParseError:
        return
    except (*DAMAGED, OSError) as error:
        raise SceneError(
            Sentence("archive-damaged", "{file} is damaged ({error}); pack it again", file=main, error=library_message(error))
        ) from error
