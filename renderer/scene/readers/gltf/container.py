"""The outside of a glTF file: JSON or GLB, and typed ways into JSON that nobody has checked."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Sequence
from typing import Any

from renderer.errors import SceneError

__all__ = ["Json", "parse"]

_MOST_DIGITS = 40
MAX_NAME = 200
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")

MAX_JSON_BYTES = 256 << 20
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


class Json:
    """An object of the JSON and where it stands, for errors. Every getter raises SceneError for a value of the wrong kind."""

    def __init__(self, file: str, where: str, value: Any) -> None:
        if not isinstance(value, dict):
            raise SceneError(f"{file}: {where or 'the file'} is not a JSON object; export it again")
        self.file, self.where, self.value = file, where, value

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def place(self, key: str) -> str:
        """The path of a key, as `materials[2].emissiveFactor`."""
        return f"{self.where}.{key}" if self.where else key

    def wrong(self, key: str, what: str) -> SceneError:
        """The error to raise for the value of a key."""
        return SceneError(f"{self.file}: {self.place(key)} {what}; export the file again")

    def object(self, key: str) -> Json | None:
        """The object under a key, if there."""
        return Json(self.file, self.place(key), self.value[key]) if key in self.value else None

    def objects(self, key: str) -> list[Json]:
        """The list of objects under a key; empty if not there."""
        values = self.value.get(key, [])
        if not isinstance(values, list):
            raise self.wrong(key, "is not a list")
        return [Json(self.file, f"{self.place(key)}[{i}]", v) for i, v in enumerate(values)]

    def integer(self, key: str, default: int | None = None, low: int = 0, high: int = 1 << 40) -> int:
        """The integer under a key, low <= it < high."""
        value = self.value.get(key, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if not isinstance(value, int) or isinstance(value, bool):
            raise self.wrong(key, "is missing" if value is None else "is not an integer")
        if not low <= value < high:
            raise self.wrong(key, f"is {value}, which points outside of what the file holds ({low} to {high - 1})")
        return value

    def index(self, key: str, into: Sequence[Any]) -> int | None:
        """The index under a key, if there, into a list."""
        return self.integer(key, high=len(into)) if key in self.value else None

    def indices(self, key: str, into: Sequence[Any]) -> list[int]:
        """The list of indices under a key into a list."""
        values = self.value.get(key, [])
        if not isinstance(values, list) or not all(isinstance(v, int) and 0 <= v < len(into) for v in values):
            raise self.wrong(key, f"is not a list of numbers from 0 to {len(into) - 1}")
        return values

    def number(self, key: str, default: float) -> float:
        """The finite number under a key."""
        value = self.value.get(key, default)
        if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
            raise self.wrong(key, "is not a number")
        return float(value)

    def vector(self, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """As many finite numbers as the default has."""
        values = self.value.get(key, default)
        good = isinstance(values, list | tuple) and len(values) == len(default)
        if not good or not all(isinstance(v, int | float) and math.isfinite(v) for v in values):
            raise self.wrong(key, f"is not a list of {len(default)} numbers")
        return tuple(float(v) for v in values)

    def numbers(self, key: str) -> tuple[float, ...]:
        """The list of finite numbers under a key; empty if not there."""
        values = self.value.get(key, [])
        if not isinstance(values, list) or not all(isinstance(v, int | float) and math.isfinite(v) for v in values):
            raise self.wrong(key, "is not a list of numbers")
        return tuple(float(v) for v in values)

    def text(self, key: str, default: str) -> str:
        """The string under a key."""
        value = self.value.get(key, default)
        if not isinstance(value, str):
            raise self.wrong(key, "is not a string")
        return value[:MAX_NAME] if key == "name" else value

    def extension(self, name: str) -> Json | None:
        """The object of an extension, if there."""
        extensions = self.object("extensions")
        return extensions.object(name) if extensions else None


def _integer(digits: str) -> int | float:
    """A whole number; one that no float holds is infinite, as 1e999 is."""
    return int(digits) if len(digits) < _MOST_DIGITS else float(digits)


def parse(data: bytes, file: str) -> tuple[Json, memoryview | None]:
    """The JSON of a .gltf or .glb, and the GLB's binary chunk. Told apart by the bytes, whatever the name says."""
    if data[:4] != b"glTF":
        return _parse_json(data, file), None
    if len(data) < 20:
        raise SceneError(f"{file}: ends inside its header; the upload or download was cut, take it again")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise SceneError(f"{file}: is GLB version {version}; export it as glTF 2.0")
    if length > len(data):
        raise SceneError(f"{file}: has {len(data)} of {length} bytes; the upload or download was cut, take it again")
    json_chunk: bytes | None = None
    binary: memoryview | None = None
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise SceneError(f"{file}: a chunk runs past the file's end; the file is damaged, export it again")
        chunk = memoryview(data)[at + 8 : at + 8 + size]
        if kind == _JSON_CHUNK and json_chunk is None:
            json_chunk = bytes(chunk)
        elif kind == _BINARY_CHUNK and binary is None:
            binary = chunk
        at += 8 + size + (-size % 4)
    if json_chunk is None:
        raise SceneError(f"{file}: has no JSON chunk; the file is damaged, export it again")
    return _parse_json(json_chunk, file), binary


def _whole(value: Any) -> Any:
    """The value with U+FFFD for what is half a character: no text that is stored or sent on may hold such."""
    if isinstance(value, str):
        return value.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    if isinstance(value, list):
        return [_whole(each) for each in value]
    return {_whole(k): _whole(v) for k, v in value.items()} if isinstance(value, dict) else value


def _parse_json(data: bytes, file: str) -> Json:
    if len(data) > MAX_JSON_BYTES:
        raise SceneError(
            f"{file}: holds {len(data) >> 20} MiB of JSON; export it as .glb, or with its buffers in files of their own"
        )
    try:
        text = data.decode("utf-8-sig")
        value = json.loads(text, parse_int=_integer)
        root = Json(file, "", _whole(value) if _SURROGATE.search(text) else value)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{file}: is no glTF: its JSON is damaged ({str(error)[:120]}); export it again") from error
    asset = root.object("asset")
    version = asset.text("version", "") if asset else ""
    if not version.startswith("2."):
        raise SceneError(f"{file}: is glTF version {version[:10] or 'unknown'}; only 2.0 is read, export it as that")
    return root
