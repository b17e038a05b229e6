"""Selects the reader of a file by its format, and converts unexpected errors of readers to SceneError.

Also reads the mesh files that Rayfarm's scene files refer to.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import PurePosixPath
from typing import Any

from renderer.confine.faults import is_of_machine
from renderer.errors import RayfarmError, SceneError
from renderer.formats import FORMATS, Format
from renderer.library_messages import library_message
from renderer.scene.animation import Moment
from renderer.scene.animation.clips import other_clips_sentence
from renderer.scene.animation.moment import ALL_CLIPS
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.names import make_readable
from renderer.scene.readers.file_damage import plain_error
from renderer.scene.text_encoding import is_readable, readable
from renderer.sentences import Sentence

__all__ = ["read_file"]


def read_file(
    files: SceneFiles,
    name: str,
    description: SceneDescription,
    variant: str | None = None,
    formats: Sequence[Format] = FORMATS,
    moment: Moment = Moment(),
    thickness: float | None = None,
) -> Format:
    """Adds the scene of one file to a description; returns the file's format.

    variant: name of one of the file's material variants, or its number from 0; None for the default. formats: the accepted
    formats. moment: the moment of the file's animation to read. thickness: width at which the file's points and lines are
    rendered, in the file's unit; None leaves them out. Raises SceneError if the file cannot be read.
    """
    suffix = PurePosixPath(name).suffix.lower()
    format = next((f for f in formats if f.suffix == suffix), None)
    if format is None:
        known = ", ".join(f.suffix for f in formats)
        raise SceneError(
            Sentence(
                "scene-format-unknown",
                "{name} is not a supported scene file; give one of {formats}",
                name=name[:120],
                formats=known,
            )
        )
    if variant is not None and not format.has_variants:
        raise SceneError(
            Sentence(
                "format-without-variants",
                "{name} has no variants; only glTF and USD files have them. Leave the variant out",
                name=name,
            )
        )
    if moment.clip is not None and not format.moves:
        raise SceneError(
            Sentence(
                "format-without-clips",
                "{name} has no clips; only glTF, USD and FBX files have them. Leave the clip out",
                name=name,
            )
        )
    if thickness is not None and not format.has_lines:
        raise SceneError(
            Sentence(
                "format-without-thickness",
                "{name} has no points or lines; only glTF files have them. Leave the thickness out",
                name=name,
            )
        )
    # Readers import heavy libraries, so each is imported at first use.
    reader = import_module(f"renderer.scene.readers.{format.reader}")
    options: dict[str, Any] = {} if variant is None else {"variant": variant}
    if format.moves:
        options["moment"] = moment
    if thickness is not None:
        options["thickness"] = thickness
    before = description.clips
    try:
        reader.read(files, name, description, **options)
    except RayfarmError as error:
        if isinstance(error, SceneError) and (plain := plain_error(files.path(name), name, error)) is not None:
            error = plain
        if is_readable(str(error)):
            raise error
        raise SceneError(readable(str(error))) from error  # a subclass may need other arguments
    except MemoryError:
        raise
    # An unexpected exception on a damaged file must not end the worker.
    except Exception as error:
        if is_of_machine(error):
            raise
        unreadable = SceneError(
            Sentence(
                "file-unreadable-as-format",
                "{name}: could not be read as {format}; it may be damaged, export it again ({error})",
                name=name,
                format=suffix,
                error=_error_text(error),
            )
        )
        raise plain_error(files.path(name), name, unreadable) or unreadable from error
    make_readable(description, files, name)
    clips = description.clips
    if moment.clip is None and clips is not before and len(clips) > 1 and clips[0].name != ALL_CLIPS:
        description.warnings.append(other_clips_sentence(name, clips))
    return format


def _error_text(error: Exception) -> str:
    said = library_message(error)
    if isinstance(said, Sentence) or said == type(error).__name__:
        return said
    return f"{type(error).__name__}: {said}"
