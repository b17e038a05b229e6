"""Tests that the published API equals openapi.txt, so that it does not change by accident.

    python -m tests.service.test_openapi

rewrites the list: each operation with its parameters, body and response, and each field of the models with its type.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from fastapi.dependencies.models import Dependant
from fastapi.params import Depends
from pydantic.fields import FieldInfo

from service.main import create_app
from service.settings import Settings

LIST = Path(__file__).with_name("openapi.txt")
Json = dict[str, Any]


def test_openapi_equals_stored_list() -> None:
    listed, found = LIST.read_text(encoding="utf-8").splitlines(), list(surface())
    gone, new = [line for line in listed if line not in found], [line for line in found if line not in listed]
    assert not gone, "clients may use these: keep them, or list the API anew (python -m tests.service.test_openapi)"
    assert not new, "not listed yet: python -m tests.service.test_openapi"


def test_parameters_of_routes_have_plain_defaults() -> None:
    """A function of a route that is called directly gets values: FastAPI's declarations are in Annotated, not the default."""
    asked = {call for route in create_app(Settings()).routes for call in _functions(getattr(route, "dependant", None))}
    assert len(asked) > 100
    wrong = [
        f"{call.__module__}.{call.__qualname__}: {parameter.name}"
        for call in asked
        for parameter in inspect.signature(call).parameters.values()
        if isinstance(parameter.default, FieldInfo | Depends)
    ]
    assert not wrong, "write name: Annotated[TYPE, Query(...)] = DEFAULT"


def test_fields_and_query_parameters_have_descriptions() -> None:
    """Each field of a model and each query parameter has a description, which the page /docs shows beside its type."""
    document = create_app(Settings()).openapi()
    models = {name: model.get("properties", {}) for name, model in document["components"]["schemas"].items()}
    assert sum(map(len, models.values())) > 400
    without = [f"{name}.{field}" for name, fields in models.items() for field, schema in fields.items() if not _text(schema)]
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            parameters = [each for each in operation.get("parameters", []) if each["in"] != "path"]
            without += [f"{method.upper()} {path} {each['name']}" for each in parameters if not _text(each)]
            forms = [
                each["schema"].get("properties", {}) for each in operation.get("requestBody", {}).get("content", {}).values()
            ]
            without += [f"{method.upper()} {path} {name}" for form in forms for name, each in form.items() if not _text(each)]
    assert not without


def _text(described: Json) -> str:
    return str(described.get("description", "")).strip()


def _functions(dependant: Dependant | None) -> Iterator[Callable[..., Any]]:
    """Yields the functions of a route and of what it depends on."""
    if dependant is not None and dependant.call is not None:
        yield dependant.call
        for needed in dependant.dependencies:
            yield from _functions(needed)


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
