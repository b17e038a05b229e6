"""Parses YAML to plain data and records the line of every value, for error messages."""

from __future__ import annotations

import math
import re
from copy import copy
from typing import Any

import yaml

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.readers.yaml.messages import yaml_fault
from renderer.sentences import Sentence

__all__ = ["Path", "Yaml", "parse"]

Path = tuple[str | int, ...]

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

MAX_BYTES = 32 << 20
MAX_VALUES = 2_000_000
MAX_ALIASED = 100_000  # values from aliases, by which a few lines could expand to billions
MAX_DEPTH = 40

# YAML 1.1, as in PyYAML, reads 1e3 as a string; YAML 1.2 and JSON read it as a number.
_FLOAT = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?$")


class Yaml:
    """Plain data (dict, list, str, int, float, bool, None), and the line of each value."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.data: Any = None
        self._lines: dict[Path, int] = {}
        self._count = 0
        self._aliased = 0
        self._taken: set[int] = set()

    def with_data(self, data: Any) -> Yaml:
        """Returns a copy with other data, such as the same file at another moment. Errors still cite the original lines."""
        other = copy(self)
        other.data = data
        return other

    def error(self, path: Path, what: str) -> SceneError:
        """Returns an error about the value at a path, with file, line and field. what: the fault, such as "is not a number"."""
        known = (path[:length] for length in range(len(path) + 1) if path[:length] in self._lines)
        at: Path = max(known, key=len, default=())
        return SceneError(
            Sentence(
                "yaml-field-invalid",
                "{file}, line {line}: {field}{fault}",
                file=self.file,
                line=self._lines.get(at, 1),
                field=_field(path),
                fault=what,
            )
        )

    def plain_data(self, node: yaml.Node, path: Path) -> Any:
        """Converts a YAML node to plain data, and records the lines of its values.

        Raises SceneError for invalid values and exceeded limits.
        """
        self._count += 1
        if self._count > MAX_VALUES:
            raise SceneError(
                Sentence(
                    "yaml-values-too-many",
                    "{file} contains more than {most} values; keep meshes in separate files",
                    file=self.file,
                    most=MAX_VALUES,
                )
            )
        self._aliased += id(node) in self._taken
        self._taken.add(id(node))
        if self._aliased > MAX_ALIASED:
            raise SceneError(
                Sentence(
                    "yaml-aliases-too-large",
                    "{file}: its aliases stand for more than {most} values; write the values out",
                    file=self.file,
                    most=MAX_ALIASED,
                )
            )
        if len(path) > MAX_DEPTH:
            raise SceneError(
                Sentence(
                    "yaml-alias-nested-too-deep",
                    "{file}, line {line}: its aliases are nested too deeply; remove one",
                    file=self.file,
                    line=node.start_mark.line + 1,
                )
            )
        self._lines[path] = node.start_mark.line + 1
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path)
        if isinstance(node, yaml.SequenceNode):
            return [self.plain_data(child, (*path, i)) for i, child in enumerate(node.value)]
        return self._scalar(node, path)

    def _mapping(self, node: yaml.MappingNode, path: Path) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value if isinstance(key_node, yaml.ScalarNode) else None
            if key is None or key == "<<":
                raise SceneError(
                    Sentence(
                        "yaml-key-not-word",
                        "{file}, line {line}: a key must be a plain word",
                        file=self.file,
                        line=key_node.start_mark.line + 1,
                    )
                )
            if key in result:
                raise SceneError(
                    Sentence(
                        "yaml-key-duplicate",
                        "{file}, line {line}: the key {key} is given twice; remove one",
                        file=self.file,
                        line=key_node.start_mark.line + 1,
                        key=key[:80],
                    )
                )
            result[key] = self.plain_data(value_node, (*path, key))
        return result

    def _scalar(self, node: yaml.Node, path: Path) -> Any:
        text: str = node.value
        tag = node.tag.rpartition(":")[2]
        plain = not getattr(node, "style", None)
        value: Any = text
        if plain and tag == "null":
            value = None
        elif plain and tag == "bool":
            value = text.lower() in ("true", "yes", "on")
        elif plain and re.fullmatch(r"[-+]?\d{1,18}", text):
            value = int(text)
        elif plain and _FLOAT.match(text):
            value = float(text)
        elif plain and tag == "float":
            raise self.error(path, Sentence("number-not-finite", "{text} is not a finite number", text=text[:40]))
        if isinstance(value, float) and not math.isfinite(value):
            raise self.error(path, Sentence("number-not-finite", "{text} is not a finite number", text=text[:40]))
        return value


def parse(data: bytes, file: str) -> Yaml:
    """Parses a file that holds one YAML document. Raises SceneError, with the line, for a syntax error or an exceeded limit."""
    if len(data) > MAX_BYTES:
        raise SceneError(
            Sentence(
                "scene-description-too-large",
                "{file} has {mib} MiB; a scene file may have at most {most}. Keep meshes in separate files",
                file=file,
                mib=len(data) >> 20,
                most=MAX_BYTES >> 20,
            )
        )
    try:
        text = data.decode("utf-8-sig")
        _check_depth(text, file)
        node = yaml.compose(text, Loader=_LOADER)
    except UnicodeDecodeError as error:
        raise SceneError(Sentence("file-not-utf-8", "{file} is not UTF-8 text; save it as UTF-8", file=file)) from error
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise SceneError(
            Sentence(
                "yaml-line-malformed",
                "{file}, line {line}: is not valid YAML: {error}",
                file=file,
                line=line,
                error=yaml_fault(error),
            )
        ) from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise SceneError(
            Sentence("yaml-malformed", "{file} is not valid YAML: {error}", file=file, error=library_message(error))
        ) from error
    result = Yaml(file)
    if node is None:
        raise SceneError(
            Sentence(
                "scene-description-empty", "{file} is empty; docs/scene-format.md describes the content of a scene", file=file
            )
        )
    result.data = result.plain_data(node, ())
    return result


def _line(event: yaml.Event) -> int:
    return event.start_mark.line + 1 if event.start_mark else 1


def _check_depth(text: str, file: str) -> None:
    # PyYAML's C composer is recursive: a few kilobytes of brackets would overflow the stack.
    depth = 0
    for event in yaml.parse(text, Loader=_LOADER):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise SceneError(
                    Sentence(
                        "yaml-nested-too-deep",
                        "{file}, line {line}: is nested too deeply; flatten it",
                        file=file,
                        line=_line(event),
                    )
                )
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def _field(path: Path) -> str:
    words = ""
    for part in path:
        words += f"[{part}]" if isinstance(part, int) else f".{part[:80]}" if words else part[:80]
    return f"{words}: " if words else ""
