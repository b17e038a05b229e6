"""Parses glTF's containers, JSON and GLB, and gives typed access to unchecked JSON."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Sequence
from typing import Any

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.readers.gltf.faults import DamagedError, Faults
from renderer.sentences import Sentence
from renderer.setting_declaration import is_name

__all__ = ["Json", "parse"]

_MOST_DIGITS = 40
_SLACK = 1e-5
MAX_NAME = 200
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")

MAX_JSON_BYTES = 256 << 20
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_CHUNKS = (_JSON_CHUNK, _BINARY_CHUNK)


class Json:
    """A JSON object of the file, with its path, and typed getters for its values.

    A value of the wrong type is replaced by the default (an empty list, None) and counted as a fault; where there is no default,
    DamagedError is raised.
    """

    def __init__(self, file: str, where: str, value: Any, faults: Faults | None = None) -> None:
        self.faults = Faults() if faults is None else faults
        if not isinstance(value, dict):
            raise DamagedError(
                file, where or Sentence("gltf-whole-file", "the file"), Sentence("gltf-not-object", "is not a JSON object")
            )
        self.file, self.where, self.value = file, where, value

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def path_of(self, key: str) -> str:
        """Returns the path of one of the object's keys in the file, such as `materials[2].emissiveFactor`."""
        return f"{self.where}.{key}" if self.where else key

    def damage(self, key: str, what: str) -> DamagedError:
        """Returns the error to raise for an unusable value. what: the fault, such as "is not a list"."""
        return DamagedError(self.file, self.path_of(key), what)

    def fault(self, key: str, what: str) -> None:
        """Counts a value as unusable, so that a warning mentions it. what: the fault, such as "is not a list"."""
        self.faults.add(self.damage(key, what))

    def replace(self, key: str, what: str) -> None:
        """Counts a value as replaced. what: the rest of a sentence that begins "3 values are"."""
        self.faults.replace(self.file, self.path_of(key), what)

    def clamped(self, key: str, value: float, low: float, high: float) -> float:
        """Returns a value clamped to low..high. A value outside by more than float32's precision is counted as replaced."""
        if not low - _SLACK <= value <= high * (1 + _SLACK) + _SLACK:
            self.replace(key, Sentence("gltf-value-clamped", "out of range and clamped"))
        return min(max(value, low), high)

    def object(self, key: str) -> Json | None:
        """Returns the object under a key; None if absent or not an object."""
        return self._child(self.path_of(key), self.value[key]) if key in self.value else None

    def objects(self, key: str) -> list[Json]:
        """Returns the list of objects under a key; entries that are not objects become empty objects."""
        values = self.value.get(key, [])
        if not isinstance(values, list):
            self.fault(key, Sentence("gltf-not-list", "is not a list"))
            return []
        places = [f"{self.path_of(key)}[{i}]" for i in range(len(values))]
        return [
            self._child(place, value) or Json(self.file, place, {}, self.faults)
            for place, value in zip(places, values, strict=True)
        ]

    def _child(self, place: str, value: Any) -> Json | None:
        try:
            return Json(self.file, place, value, self.faults)
        except DamagedError as fault:
            self.faults.add(fault)
            return None

    def integer(self, key: str, default: int | None = None, low: int = 0, high: int = 1 << 40) -> int:
        """Returns the integer under a key, low <= value < high.

        An absent or unusable value becomes the default; without a default, DamagedError is raised.
        """
        value = self.value.get(key, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if not isinstance(value, int) or isinstance(value, bool):
            fault = self.damage(
                key,
                Sentence("gltf-value-missing", "is missing")
                if value is None
                else Sentence("gltf-not-integer", "is not an integer"),
            )
        elif not low <= value < high:
            fault = self.damage(
                key,
                Sentence(
                    "gltf-index-out-of-range",
                    "is {value}; valid are {low} to {high}",
                    value=value,
                    low=low,
                    high=high - 1,
                )
                if high > low
                else Sentence("gltf-index-into-empty-list", "is {value}, an index into an empty list", value=value),
            )
        else:
            return value
        if default is None:
            raise fault
        self.faults.add(fault)
        return default

    def index(self, key: str, into: Sequence[Any]) -> int | None:
        """Returns the index under a key; None if it is absent or outside the list `into`."""
        if key not in self.value:
            return None
        try:
            return self.integer(key, high=len(into))
        except DamagedError as fault:
            self.faults.add(fault)
            return None

    def indices(self, key: str, into: Sequence[Any]) -> list[int]:
        """Returns the list of indices under a key, without those that are outside the list `into`."""
        values = self.value.get(key, [])
        listed = values if isinstance(values, list) else []
        good = [v for v in listed if isinstance(v, int) and not isinstance(v, bool) and 0 <= v < len(into)]
        if not isinstance(values, list) or len(good) < len(values):
            self.fault(
                key,
                Sentence("gltf-not-index-list", "is not a list of numbers from 0 to {high}", high=len(into) - 1)
                if into
                else Sentence("gltf-indices-into-empty-list", "has indices into an empty list"),
            )
        return good

    def number(self, key: str, default: float) -> float:
        """Returns the finite number under a key."""
        value = self.value.get(key, default)
        if not _is_finite(value):
            self.fault(key, Sentence("gltf-not-number", "is not a number"))
            return default
        return float(value)

    def vector(self, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Returns the list of numbers under a key; the default unless it has the same length and all numbers are finite."""
        values = self.value.get(key, default)
        good = isinstance(values, list | tuple) and len(values) == len(default)
        if not good or not all(map(_is_finite, values)):
            self.fault(key, Sentence("number-list-malformed", "is not a list of {count} numbers", count=len(default)))
            return default
        return tuple(float(v) for v in values)

    def numbers(self, key: str) -> tuple[float, ...]:
        """Returns the list of numbers under a key, with 0 for entries that are not finite numbers."""
        values = self.value.get(key, [])
        if not isinstance(values, list) or not all(map(_is_finite, values)):
            self.fault(key, Sentence("gltf-not-number-list", "is not a list of numbers"))
            return tuple(float(v) if _is_finite(v) else 0.0 for v in values) if isinstance(values, list) else ()
        return tuple(float(v) for v in values)

    def text(self, key: str, default: str) -> str:
        """Returns the string under a key; names are cut to MAX_NAME characters."""
        value = self.value.get(key, default)
        if not isinstance(value, str):
            self.fault(key, Sentence("gltf-not-string", "is not a string"))
            return default
        return value[:MAX_NAME] if key == "name" else value

    def name_in_extras(self, key: str) -> str:
        """Returns the name under a key of the object's extras, such as a light group; empty if absent."""
        extras = self.object("extras") if isinstance(self.value.get("extras"), dict) else None
        found = extras.text(key, "").strip() if extras is not None else ""
        if found and not is_name(found):
            self.fault("extras", Sentence("gltf-extras-name-invalid", "has a {key} that is not a name", key=key))
            return ""
        return found

    def names_in_extras(self, key: str, known: Sequence[str]) -> list[str] | None:
        """Returns the list of names under a key of the object's extras; None if absent or not a list of known names."""
        extras = self.value.get("extras")
        if not isinstance(extras, dict) or key not in extras:
            return None
        found = extras[key]
        if not isinstance(found, list) or not all(name in known for name in found):
            self.fault(
                "extras",
                Sentence("gltf-extras-names-invalid", "has a {key} that is not a list of {known}", key=key, known=[*known]),
            )
            return None
        return found

    def flag_in_extras(self, key: str) -> bool:
        """Returns True if the object's extras have True under a key."""
        extras = self.value.get("extras")
        return isinstance(extras, dict) and extras.get(key) is True

    def extension(self, name: str) -> Json | None:
        """Returns the object of an extension, or None if absent."""
        extensions = self.object("extensions")
        return extensions.object(name) if extensions else None


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _integer(digits: str) -> int | float:
    """Returns the integer that the digits represent; infinity beyond float's range, as for 1e999."""
    return int(digits) if len(digits) < _MOST_DIGITS else float(digits)


def parse(data: bytes, file: str) -> tuple[Json, memoryview | None]:
    """Parses a .gltf or .glb file. Returns its JSON, and the GLB's binary chunk or None.

    The format is detected by the content, not by the name. A wrong length of the file or of its binary chunk, and chunks without
    padding, are counted as faults. Raises SceneError if the file cannot be parsed.
    """
    if data[:4] != b"glTF":
        return _parse_json(data, file), None
    if len(data) < 20:
        raise SceneError(
            Sentence(
                "gltf-header-cut-off",
                "{file} ends inside its header; the upload or download was interrupted, repeat it",
                file=file,
            )
        )
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise SceneError(
            Sentence(
                "gltf-glb-version-unsupported",
                "{file} is GLB version {version}; export it as glTF 2.0",
                file=file,
                version=version,
            )
        )
    notes = []
    if length != len(data):
        notes.append(
            Sentence(
                "gltf-glb-length-differs",
                "{file} has {found} bytes, but its header says {declared}; all are read.",
                file=file,
                found=len(data),
                declared=length,
            )
        )
    chunks: dict[int, memoryview] = {}
    at = 12
    while at + 8 <= len(data):
        size, kind = struct.unpack_from("<II", data, at)
        end = at + 8 + size
        if end > len(data):
            if kind == _JSON_CHUNK:
                raise SceneError(
                    Sentence(
                        "gltf-json-cut-off",
                        "{file} ends inside its JSON; the upload or download was interrupted, repeat it",
                        file=file,
                    )
                )
            if kind in _CHUNKS:
                notes.append(
                    Sentence(
                        "gltf-binary-cut-off",
                        "{file}: its binary data has {found} of {size} bytes; these are read.",
                        file=file,
                        found=len(data) - at - 8,
                        size=size,
                    )
                )
        if kind in _CHUNKS:
            chunks.setdefault(kind, memoryview(data)[at + 8 : end])
        at = end
        if size % 4:
            is_padded = not _is_chunk(data, end) and (_is_chunk(data, end + -size % 4) or end + -size % 4 == len(data))
            at += -size % 4 if is_padded else 0
            notes.append(
                Sentence(
                    "gltf-chunk-unaligned",
                    "{file}: a chunk has {size} bytes, not a multiple of four; it is read nevertheless.",
                    file=file,
                    size=size,
                )
            )
    if _JSON_CHUNK not in chunks:
        raise SceneError(
            Sentence("gltf-json-chunk-missing", "{file} has no JSON chunk; the file is damaged, export it again", file=file)
        )
    root = _parse_json(bytes(chunks[_JSON_CHUNK]), file)
    for sentence in notes:
        root.faults.add_sentence(sentence)
    return root, chunks.get(_BINARY_CHUNK)


def _is_chunk(data: bytes, at: int) -> bool:
    return at + 8 <= len(data) and struct.unpack_from("<I", data, at + 4)[0] in _CHUNKS


def _without_lone_surrogates(value: Any) -> Any:
    """Returns the JSON value with lone surrogates replaced by U+FFFD, so that its strings can be encoded."""
    if isinstance(value, str):
        return value.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    if isinstance(value, list):
        return [_without_lone_surrogates(each) for each in value]
    return (
        {_without_lone_surrogates(k): _without_lone_surrogates(v) for k, v in value.items()} if isinstance(value, dict) else value
    )


def _parse_json(data: bytes, file: str) -> Json:
    if len(data) > MAX_JSON_BYTES:
        raise SceneError(
            Sentence(
                "gltf-json-too-large",
                "{file} contains {mib} MiB of JSON; export it as .glb, or with its buffers in separate files",
                file=file,
                mib=len(data) >> 20,
            )
        )
    try:
        text = data.decode("utf-8-sig").rstrip("\0 ")
        value = json.loads(text, parse_int=_integer)
        root = Json(file, "", _without_lone_surrogates(value) if _SURROGATE.search(text) else value)
    except (ValueError, RecursionError) as error:
        raise SceneError(
            Sentence(
                "gltf-json-damaged",
                "{file} is damaged or not a glTF file. Export it again ({error})",
                file=file,
                error=library_message(error),
            )
        ) from error
    asset = root.object("asset")
    version = asset.text("version", "") if asset else ""
    if not version.startswith("2."):
        raise SceneError(
            Sentence(
                "gltf-version-unsupported",
                "{file} is glTF version {version}; only 2.0 is supported. Export it as 2.0",
                file=file,
                version=version[:10] or "unknown",
            )
        )
    return root
