"""Options of pbrt; most affect only how it runs."""

from __future__ import annotations

from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.statements import Statement
from renderer.sentences import Sentence

__all__ = ["note_option"]

_OF_THE_PICTURE = {
    "forcediffuse": "surfaces are as their materials say",
    "disablepixeljitter": "a pixel's samples lie all over it",
    "disabletexturefiltering": "textures are interpolated",
}
_OF_THE_RUN = (
    *("disablewavelengthjitter", "displacementedgescale", "fullscreen", "gpudevice", "interactive", "msereferenceimage"),
    *("msereferenceout", "nthreads", "pixelstats", "quickrender", "quiet", "recordpixelstatistics", "rendercoordsys", "seed"),
    *("upgrade", "usegpu", "wavefront", "writepartialimages"),
)  # displacement is noted at the material


def note_option(name: str, statement: Statement, notes: Notes) -> None:
    """Adds a note if an option is on and would change the image."""
    key = name.split()[-1].replace("_", "").replace("-", "").lower()
    said = statement.arguments[1] if len(statement.arguments) > 1 else ""
    is_on = said == "true" or (isinstance(said, tuple) and said[:1] in ((True,), ("true",)))
    if is_on and key in _OF_THE_PICTURE:
        notes.add(
            statement.place,
            Sentence(
                "pbrt-option-ignored",
                "The option {option} is not taken over: {reason}",
                option=key,
                reason=_OF_THE_PICTURE[key],
            ),
        )
    elif key not in _OF_THE_PICTURE and key not in _OF_THE_RUN:
        notes.add(
            statement.place,
            Sentence("pbrt-option-unknown", "The option {name} is not known, and not taken over", name=repr(name[:60])),
        )
