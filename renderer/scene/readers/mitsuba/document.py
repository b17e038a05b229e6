"""Parses a Mitsuba scene file into elements, with defaults, includes and references resolved."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any
from xml.etree import ElementTree

import numpy as np

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.mitsuba import values
from renderer.scene.readers.mitsuba.values import Matrix
from renderer.scene.readers.xml import refuse_entities
from renderer.scene.warning_list import WarningList
from renderer.sentences import Sentence, with_count

__all__ = ["Document", "Element"]

_OBJECTS = (
    "scene",
    "shape",
    "bsdf",
    "emitter",
    "sensor",
    "film",
    "rfilter",
    "sampler",
    "texture",
    "integrator",
    "medium",
    "phase",
    "volume",
)
_OLD_NAMES = {"subsurface": "medium", "luminaire": "emitter", "camera": "sensor", "spectrum": "texture"}
_OBJECT_ATTRIBUTES = ("type", "id", "name", "version")  # attributes of objects
_IGNORED_VALUE_ATTRIBUTES = {"intent", "unit"}  # of Mitsuba 0.6's spectra: redundant, or always nanometres
MAX_INCLUDES = 32
MAX_ELEMENTS = 2_000_000
MAX_DEPTH = 60


@dataclass(eq=False)
class Element:
    """An object of the scene.

    tag: its XML tag, such as shape or bsdf; type: its plugin; name: the parameter of its parent that it sets.
    """

    tag: str
    type: str
    id: str = ""
    name: str = ""
    file: str = ""  # file that contains it
    values: dict[str, Any] = field(default_factory=dict)
    children: list[Element] = field(default_factory=list)
    used: set[str] = field(default_factory=set)

    def mark_used(self) -> None:
        """Marks the object as used, even if none of its properties is read."""
        self.used.add("")

    def get(self, name: str, default: Any = None) -> Any:
        """Returns a property's value, and marks the property as used."""
        self.used.add(name)
        return self.values.get(name, default)

    def number(self, name: str, default: float) -> float:
        """Returns a property as a number, whatever its type in the file; for a colour, the mean of its channels.

        Raises SceneError for text that is not a number.
        """
        found = self.get(name, default)
        if isinstance(found, np.ndarray):
            return float(found.mean())
        if isinstance(found, values.Spectrum):
            return found.mean
        if isinstance(found, str):
            raise SceneError(
                Sentence(
                    "mitsuba-number-expected",
                    "{file}: {name} of {what} is {found}; it must be a number",
                    file=self.file,
                    name=name,
                    what=self.description,
                    found=repr(found[:40]),
                )
            )
        return float(found)

    def boolean(self, name: str, default: bool) -> bool:
        """Returns a property as a boolean."""
        found = self.get(name, default)
        return found if isinstance(found, bool) else str(found).strip().lower() == "true"

    def matrix(self, name: str = "to_world") -> Matrix:
        """Returns a transform property; the identity if absent."""
        found = self.get(name)
        return found if isinstance(found, np.ndarray) and found.shape == (4, 4) else np.eye(4)

    def children_of(self, *tags: str) -> list[Element]:
        """Returns the child objects whose tag is among `tags`."""
        return [child for child in self.children if child.tag in tags]

    def child(self, name: str) -> Element | None:
        """Returns the child object with a name, such as a texture in place of a colour; None if absent."""
        self.used.add(name)
        return next((child for child in self.children if child.name == name), None)

    @property
    def description(self) -> str:
        """The object's tag, id and type, as a text for messages."""
        return f"{self.tag} {self.id!r} ({self.type})" if self.id else f"{self.tag} ({self.type})"


class _Attributes(dict[str, str]):
    """The attributes of an XML element; records which of them were read."""

    def __init__(self, written: Mapping[str, str]) -> None:
        super().__init__(written)
        self.asked = {"name", "id", "value"}

    def get(self, key: str, default: Any = None) -> Any:
        """Returns an attribute, or the default if it is absent."""
        self.asked.add(key)
        return super().get(key, default)

    def __getitem__(self, key: str) -> str:
        self.asked.add(key)
        return super().__getitem__(key)


def _is_object(part: ElementTree.Element) -> bool:
    """Returns True if an XML element represents an object rather than a value.

    A spectrum is an object only if it names a plugin.
    """
    return bool(part.get("type")) if part.tag == "spectrum" else _OLD_NAMES.get(part.tag, part.tag) in _OBJECTS


class Document:
    """Parses a file and its includes. Raises SceneError if the file is not a scene or exceeds the limits."""

    def __init__(self, files: SceneFiles, main: str, description: SceneDescription) -> None:
        self.files, self.main = files, main
        self._warned = WarningList(description.warnings)
        self._defaults: dict[str, str] = {}
        self._by_id: dict[str, Element] = {}
        self._includes = 0
        self._elements = 0
        self._ignored: Counter[str] = Counter()
        root = self._parsed(main)
        if root.tag != "scene":
            raise SceneError(
                Sentence(
                    "mitsuba-root-element-wrong",
                    "{file} begins with <{tag}>; a Mitsuba scene begins with <scene>",
                    file=main,
                    tag=root.tag[:40],
                )
            )
        self.is_old = root.get("version", "3").startswith("0.")
        self._waiting: list[tuple[Element, int, str, str, str]] = []
        self.scene = self._object(root, main, 0)
        for made, at, wanted, name, where in self._waiting:
            made.children[at] = self._resolve_reference(wanted, name, where)

    def warn(self, sentence: str) -> None:
        """Adds a warning, unless the same one was added before."""
        self._warned.add(sentence)

    def ignore(self, what: str) -> None:
        """Counts an occurrence of unsupported content. what: the sentence of the warning about it."""
        self._ignored[what] += 1

    @property
    def ignored(self) -> list[str]:
        """Returns the sentences about unsupported content found so far."""
        return list(self._ignored)

    def warn_of_ignored(self) -> None:
        """Adds a warning for each kind of unsupported content that was counted, with the number of occurrences."""
        for what, count in self._ignored.items():
            self.warn(with_count(what, count))

    def _parsed(self, name: str) -> ElementTree.Element:
        data = self.files.read(name)
        refuse_entities(data, name)
        try:
            return ElementTree.fromstring(data)
        except ElementTree.ParseError as error:
            raise SceneError(
                Sentence(
                    "mitsuba-xml-unreadable",
                    "{name} is not valid XML ({error}); correct it",
                    name=name,
                    error=library_message(error),
                )
            ) from None

    def _object(self, source: ElementTree.Element, file: str, depth: int) -> Element:
        self._elements += 1
        if depth > MAX_DEPTH or self._elements > MAX_ELEMENTS:
            raise SceneError(
                Sentence(
                    "mitsuba-elements-too-many",
                    "{file} has too many or too deeply nested elements; make the scene smaller",
                    file=file,
                )
            )
        tag = _OLD_NAMES.get(source.tag, source.tag)
        made = Element(tag, self._text(source, "type", file), source.get("id", ""), self._key(source.get("name", "")), file)
        self._ignore_unknown_attributes(source, _OBJECT_ATTRIBUTES)
        for part, where in self._with_includes(source, file):
            if part.tag == "default":
                self._defaults.setdefault(part.get("name", ""), part.get("value", ""))
            elif part.tag == "ref":
                self._add_reference(part, made, where)
            elif _is_object(part):
                made.children.append(self._object(part, where, depth + 1))
            elif part.tag == "alias":
                self._rename(part, where)
            elif part.tag != "path":  # files are found regardless of search paths
                name = self._key(part.get("name", ""))
                if name in made.values:
                    self.ignore(
                        Sentence(
                            "parameter-given-twice",
                            "{name} of {what} is given more than once: the last one is used",
                            name=name[:60],
                            what=made.description,
                        )
                    )
                made.values[name] = self._value(part, where)
        if made.id and made.id in self._by_id:
            self.ignore(
                Sentence(
                    "mitsuba-id-duplicate",
                    "{what} has the id of another object: later references mean this one",
                    what=made.description,
                )
            )
        if made.id:
            self._by_id[made.id] = made
        return made

    def _with_includes(self, source: ElementTree.Element, file: str) -> Iterator[tuple[ElementTree.Element, str]]:
        """Yields the children of an element and the file of each. An include is replaced by the children of the included file."""
        for part in source:
            if part.tag != "include":
                yield part, file
                continue
            self._includes += 1
            wanted = self._text(part, "filename", file)
            found = self.files.find(wanted, file)
            if self._includes > MAX_INCLUDES:
                raise SceneError(
                    Sentence(
                        "mitsuba-includes-too-many",
                        "{file}: more than {most} files are included; do they include each other?",
                        file=file,
                        most=MAX_INCLUDES,
                    )
                )
            if found is None:
                raise SceneError(
                    Sentence(
                        "mitsuba-include-missing",
                        "{file} includes {name}, which is not among the files; add it",
                        file=file,
                        name=PurePosixPath(wanted).name[:120],
                    )
                )
            yield from self._with_includes(self._parsed(found), found)

    def _add_reference(self, part: ElementTree.Element, material: Element, file: str) -> None:
        wanted, name = self._text(part, "id", file), self._key(part.get("name", ""))
        if wanted in self._by_id:
            material.children.append(self._resolve_reference(wanted, name, file))
            return
        self._waiting.append((material, len(material.children), wanted, name, file))  # may be defined later
        material.children.append(material)

    def _resolve_reference(self, id: str, name: str, file: str) -> Element:
        found = self._by_id.get(id)
        if found is None:
            raise SceneError(
                Sentence(
                    "mitsuba-reference-unknown",
                    "{file} refers to {id}, which is not in the scene; correct the reference",
                    file=file,
                    id=repr(id[:80]),
                )
            )
        if name and name != found.name:
            return Element(found.tag, found.type, found.id, name, found.file, found.values, found.children, found.used)
        return found

    def _rename(self, part: ElementTree.Element, file: str) -> None:
        wanted, name = self._text(part, "id", file), self._text(part, "as", file)
        if wanted not in self._by_id:
            raise SceneError(
                Sentence(
                    "mitsuba-alias-unknown",
                    "{file}: an alias refers to {id}, which is not defined before it; correct the alias",
                    file=file,
                    id=repr(wanted[:80]),
                )
            )
        self._by_id[name] = self._by_id[wanted]

    def _ignore_unknown_attributes(self, part: ElementTree.Element, known: Container[str]) -> None:
        """Counts the attributes of an element that are not among the known ones as ignored."""
        for key in part.keys():  # noqa: SIM118 - an element is no dict
            if key not in known:
                self.ignore(
                    Sentence(
                        "mitsuba-attribute-ignored",
                        "The attribute {attribute} of <{tag}> is ignored",
                        attribute=key[:40],
                        tag=part.tag[:40],
                    )
                )

    def _value(self, part: ElementTree.Element, file: str) -> Any:
        def attributes(source: ElementTree.Element) -> _Attributes:
            return _Attributes({key: self._text(source, key, file) for key in source.keys()})  # noqa: SIM118

        written, steps = attributes(part), []
        inner = part
        if part.tag in ("transform", "animation"):
            inner = part if part.tag == "transform" else next(iter(part), part)
            if part.tag == "animation":
                self.ignore(
                    Sentence("mitsuba-animation-ignored", "Animated transforms are not supported: the first pose is shown")
                )
            steps = [(step.tag, attributes(step)) for step in inner]
        elif len(part):
            name = part.get("name", "")
            self.ignore(
                Sentence(
                    "mitsuba-children-ignored",
                    "The content of <{tag} name={name}> is ignored",
                    tag=part.tag[:40],
                    name=repr(name[:40]),
                )
            )
        try:
            found = values.value(part.tag, written, steps, lambda name: self._curve(name, file))
            self._ignore_unknown_attributes(part, written.asked | _IGNORED_VALUE_ATTRIBUTES)
            for step, (_, said) in zip(inner if steps else (), steps, strict=True):
                self._ignore_unknown_attributes(step, said.asked)
            is_even = part.tag == "spectrum" and not self.is_old and isinstance(found, np.ndarray) and len(set(found)) == 1
            return values.Spectrum.constant(float(found[0])) if is_even else found
        except ValueError as error:
            raise SceneError(
                Sentence(
                    "mitsuba-element-invalid",
                    "{file}: <{tag} name={name}>: {error}",
                    file=file,
                    tag=part.tag[:40],
                    name=repr(written.get("name", "")[:40]),
                    error=library_message(error),
                )
            ) from None

    def _curve(self, name: str, file: str) -> str:
        found = self.files.find(name, file)
        if found is None:
            raise ValueError(
                Sentence(
                    "mitsuba-referenced-file-missing",
                    "its file {name} is not among the files; add it",
                    name=PurePosixPath(name).name[:120],
                )
            )
        return self.files.read(found).decode("utf-8", "replace")

    def _text(self, source: ElementTree.Element, key: str, file: str) -> str:
        """Returns an XML attribute in which each $name, a parameter of the scene, is replaced by its default value."""
        text = source.get(key, "")
        if "$" not in text:
            return text

        def default(match: re.Match[str]) -> str:
            name = match.group(1) or match.group(2)
            if name not in self._defaults:
                raise SceneError(
                    Sentence(
                        "mitsuba-default-missing",
                        "{file}: ${name} has no value; write <default name={name2} value=...> before it",
                        file=file,
                        name=name[:40],
                        name2=repr(name[:40]),
                    )
                )
            return self._defaults[name]

        return re.sub(r"\$(?:\{(\w+)\}|(\w+))", default, text)

    def _key(self, name: str) -> str:
        """Returns a property's name in Mitsuba 3's spelling: toWorld in version 0.6 becomes to_world."""
        return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower() if getattr(self, "is_old", False) else name
