"""Tests that the published API equals openapi.txt, so that it does not change by accident.

    python -m tests.service.test_openapi

rewrites the list: each operation with its parameters, body and response, and each field of the models with its type.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from service.main import create_app
from service.settings import Settings

LIST = Path(__file__).with_name("openapi.txt")
Json = dict[str, Any]


def test_openapi_equals_stored_list() -> None:
    listed, found = LIST.read_text(encoding="utf-8").splitlines(), list(surface())
    gone, new = [line for line in listed if line not in found], [line for line in found if line not in listed]
    assert not gone, "clients may use these: keep them, or list the API anew (python -m tests.service.test_openapi)"
    assert not new, "not listed yet: python -m tests.service.test_openapi"


def surface() -> Iterator[str]:
    """Yields the lines of openapi.txt that describe the application's OpenAPI document."""
    document = create_app(Settings()).openapi()
    for path, operations in sorted(document["paths"].items()):
        for method, operation in sorted(operations.items()):
            yield f"{method.upper()} {path}"
            for each in operation.get("parameters", []):
                optional = "" if each.get("required") else "?"
                yield f"{method.upper()} {path} {each['in']} {each['name']}{optional}: {kind(each['schema'])}"
            if body := operation.get("requestBody"):
                yield from (f"{method.upper()} {path} body {of(media)}" for media in sorted(body["content"].items()))
            for status, answer in sorted(operation["responses"].items()):
                media = sorted(answer.get("content", {}).items()) or [("", {})]
                yield from (f"{method.upper()} {path} {status} {of(each)}".rstrip() for each in media)
    for name, model in sorted(document["components"]["schemas"].items()):
        required = model.get("required", [])
        for field, schema in sorted(model.get("properties", {}).items()):
            yield f"{name}.{field}{'' if field in required else '?'}: {kind(schema)}"


def of(media: tuple[str, Json]) -> str:
    """Returns a media type with its schema."""
    type, content = media
    return f"{type} {kind(content.get('schema', {}))}".strip()


def kind(schema: Json) -> str:
    """Returns a short description of a value's type."""
    if "$ref" in schema:
        return str(schema["$ref"]).rsplit("/", 1)[-1]
    if "anyOf" in schema:
        return " | ".join(map(kind, schema["anyOf"]))
    if "enum" in schema:
        return " | ".join(map(repr, schema["enum"]))
    if "const" in schema:
        return repr(schema["const"])
    if schema.get("type") == "array":
        return f"[{kind(schema.get('items', {}))}]"
    if "properties" in schema:
        return f"{{{', '.join(sorted(schema['properties']))}}}"
    return str(schema.get("type", ""))


if __name__ == "__main__":
    LIST.write_text("\n".join(surface()) + "\n", encoding="utf-8")
