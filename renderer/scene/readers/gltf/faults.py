"""Collects the unusable parts of a glTF file, which are left out, counted, and reported in warnings."""

from __future__ import annotations

from collections.abc import Callable

from renderer.errors import SceneError
from renderer.sentences import Sentence, first_items

__all__ = ["DamagedError", "Faults"]

_MAX_LISTED = 6  # places that a warning lists
EXPORT_AGAIN = Sentence("advice-export-again", "export the file again")


class DamagedError(SceneError):
    """A part of the file is unusable; the rest can be read without it. Limits and missing decoders raise other errors."""

    def __init__(self, file: str, place: str, what: str, advice: str = EXPORT_AGAIN) -> None:
        super().__init__(
            Sentence("gltf-part-unusable", "{file}: {place} {fault}; {advice}", file=file, place=place, fault=what, advice=advice)
        )
        self.file, self.place, self.what, self.advice = file, place, what, advice

    def __reduce__(self) -> tuple[type[DamagedError], tuple[str, str, str, str]]:
        """Pickles the arguments, as the error leaves the process that reads untrusted files."""
        return type(self), (self.file, self.place, self.what, self.advice)


class Faults:
    """The unusable parts of one file, grouped by fault. A part that is added twice counts once."""

    def __init__(self) -> None:
        self._places: dict[str, dict[str, None]] = {}
        self._notes: dict[str, None] = {}
        self._replaced: dict[str, dict[str, None]] = {}
        self._file = ""
        self.first: DamagedError | None = None

    def add(self, fault: DamagedError) -> None:
        """Counts a part that is left out."""
        self.first = self.first or fault
        self._file = fault.file
        self._places.setdefault(fault.what, {})[fault.place] = None

    def replace(self, file: str, place: str, what: str) -> None:
        """Counts a value that is replaced by another. what: the rest of a sentence that begins "3 values are"."""
        self._file = file
        self._replaced.setdefault(what, {})[place] = None

    def add_sentence(self, sentence: str) -> None:
        """Records a sentence about the file as a whole."""
        self._notes[sentence] = None

    def pass_on(self, warn: Callable[[str], None]) -> None:
        """Calls `warn` with each recorded sentence, and with one sentence per kind of fault that contains the number of parts."""
        for sentence in self._notes:
            warn(sentence)
        for what, places in self._places.items():
            if len(places) == 1:
                warn(
                    Sentence(
                        "gltf-part-left-out",
                        "{file}: 1 unusable part is left out ({fault}): {places}.",
                        file=self._file,
                        fault=what,
                        places=_listed(places),
                    )
                )
                continue
            warn(
                Sentence(
                    "gltf-parts-left-out",
                    "{file}: {count} unusable parts are left out ({fault}): {places}.",
                    file=self._file,
                    count=len(places),
                    fault=what,
                    places=_listed(places),
                )
            )
        for what, places in self._replaced.items():
            if len(places) == 1:
                warn(
                    Sentence(
                        "gltf-value-replaced",
                        "{file}: 1 value is {replacement}: {places}.",
                        file=self._file,
                        replacement=what,
                        places=_listed(places),
                    )
                )
                continue
            warn(
                Sentence(
                    "gltf-values-replaced",
                    "{file}: {count} values are {replacement}: {places}.",
                    file=self._file,
                    count=len(places),
                    replacement=what,
                    places=_listed(places),
                )
            )


def _listed(places: dict[str, None]) -> list[str]:
    return first_items(places, _MAX_LISTED)
