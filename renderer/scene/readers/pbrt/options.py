"""Options of pbrt scenes; most affect only how pbrt runs, not the image."""

from __future__ import annotations

from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.statements import Statement
from renderer.sentences import Sentence

__all__ = ["note_option"]

_IMAGE_OPTIONS = {
    "forcediffuse": Sentence("pbrt-force-diffuse-ignored", "The option forcediffuse is ignored: materials are used as defined"),
    "disablepixeljitter": Sentence(
        "pbrt-pixel-jitter-kept", "The option disablepixeljitter is ignored: samples are spread over the pixel"
    ),
    "disabletexturefiltering": Sentence(
        "pbrt-texture-filtering-kept", "The option disabletexturefiltering is ignored: textures are interpolated"
    ),
}
_RUN_OPTIONS = (
    *("disablewavelengthjitter", "displacementedgescale", "fullscreen", "gpudevice", "interactive", "msereferenceimage"),
    *("msereferenceout", "nthreads", "pixelstats", "quickrender", "quiet", "recordpixelstatistics", "rendercoordsys", "seed"),
    *("upgrade", "usegpu", "wavefront", "writepartialimages"),
)  # displacement is noted at the material


def note_option(name: str, statement: Statement, notes: Notes) -> None:
    """Adds a note if an option is unknown, or is on and would change the image."""
    key = name.split()[-1].replace("_", "").replace("-", "").lower()
    said = statement.arguments[1] if len(statement.arguments) > 1 else ""
    is_on = said == "true" or (isinstance(said, tuple) and said[:1] in ((True,), ("true",)))
    if is_on and key in _IMAGE_OPTIONS:
        notes.add(statement.place, _IMAGE_OPTIONS[key])
    elif key not in _IMAGE_OPTIONS and key not in _RUN_OPTIONS:
        notes.add(
            statement.place,
            Sentence("pbrt-option-unknown", "The option {name} is unknown and ignored", name=repr(name[:60])),
        )
