"""Codes and sentences for the messages of the YAML parser and of the schema validator."""

from __future__ import annotations

import difflib
import json
from typing import Any

import yaml

from renderer.sentences import Sentence, first_items

__all__ = ["schema_fault", "yaml_fault"]

_MOST_NAMED = 12
_MOST_SHOWN = 80  # characters of a value

_YAML_MESSAGES: dict[str, str] = {
    str.__str__(each): each
    for each in (
        Sentence("yaml-mapping-not-allowed", "mapping values are not allowed in this context"),
        Sentence("yaml-mapping-not-allowed-here", "mapping values are not allowed here"),
        Sentence("yaml-sequence-not-allowed", "block sequence entries are not allowed in this context"),
        Sentence("yaml-colon-missing", "could not find expected ':'"),
        Sentence("yaml-key-missing", "did not find expected key"),
        Sentence("yaml-dash-missing", "did not find expected '-' indicator"),
        Sentence("yaml-list-not-closed", "did not find expected ',' or ']'"),
        Sentence("yaml-object-not-closed", "did not find expected ',' or '}'"),
        Sentence("yaml-node-missing", "did not find expected node content"),
        Sentence("yaml-document-start-missing", "did not find expected <document start>"),
        Sentence("yaml-several-documents", "but found another document"),
        Sentence("yaml-character-invalid", "found character that cannot start any token"),
        Sentence("yaml-tab-in-indentation", "found a tab character that violates indentation"),
        Sentence("yaml-tab-as-separator", "found a tab character where an indentation space is expected"),
        Sentence("yaml-stream-ended", "found unexpected end of stream"),
        Sentence("yaml-alias-undefined", "found undefined alias"),
        Sentence("yaml-escape-unknown", "found unknown escape character"),
        Sentence("yaml-control-characters", "control characters are not allowed"),
        Sentence("yaml-anchor-duplicate", "found duplicate anchor"),
    )
}
_TYPES: dict[str, str] = {
    "object": Sentence("schema-object", "an object"),
    "array": Sentence("schema-list", "a list"),
    "string": Sentence("schema-text", "a text"),
    "number": Sentence("schema-number", "a number"),
    "integer": Sentence("schema-integer", "an integer"),
    "boolean": Sentence("schema-boolean", "true or false"),
    "null": Sentence("schema-null", "null"),
}


def yaml_fault(error: yaml.MarkedYAMLError) -> str:
    """Returns the sentence for an error of the YAML parser; an unknown message is returned unchanged."""
    text = error.problem or error.context or ""
    return _YAML_MESSAGES.get(text, text)


def schema_fault(error: Any) -> str:
    """Returns the sentence for an error of the schema validator; an unknown message is returned unchanged."""
    value, wanted = error.instance, error.validator_value
    shown = json.dumps(value, ensure_ascii=False, default=str)
    shown = shown if len(shown) <= _MOST_SHOWN else f"{shown[:_MOST_SHOWN]}..."
    match error.validator:
        case "type":
            types = [_TYPES.get(each, each) for each in ([wanted] if isinstance(wanted, str) else wanted)]
            return Sentence("schema-type-wrong", "is {value}; possible: {types}", value=shown, types=types)
        case "enum":
            choices = first_items(wanted, 40)
            return Sentence("value-unknown", "is {value}; known are {choices}", value=shown, choices=choices)
        case "const":
            return Sentence("schema-constant-wrong", "is {value}; it must be {wanted}", value=shown, wanted=json.dumps(wanted))
        case "required":
            missing = [name for name in wanted if name not in value]
            return Sentence("schema-fields-missing", "lacks {names}", names=missing)
        case "additionalProperties":
            known = error.schema.get("properties", {})
            unknown = [str(name)[:60] for name in value if name not in known]
            near = difflib.get_close_matches(unknown[0], known, 1)
            if len(unknown) == 1 and near:
                return Sentence(
                    "schema-field-misspelt", "has the unknown field {name} (did you mean {near}?)", name=unknown[0], near=near[0]
                )
            odd = first_items(unknown, _MOST_NAMED)
            return Sentence("schema-fields-unknown", "has unknown fields: {names}", names=odd)
        case "minimum":
            return Sentence("schema-below-minimum", "is {value}; it must be at least {least}", value=shown, least=f"{wanted:g}")
        case "maximum":
            return Sentence("schema-above-maximum", "is {value}; it must be at most {most}", value=shown, most=f"{wanted:g}")
        case "exclusiveMinimum":
            return Sentence("number-too-small", "is {number}; it must be above {low}", number=shown, low=f"{wanted:g}")
        case "minItems":
            return Sentence("schema-items-too-few", "has {count} of at least {least} items", count=len(value), least=wanted)
        case "maxItems":
            return Sentence(
                "schema-items-too-many", "has {count} items; at most {most} are allowed", count=len(value), most=wanted
            )
        case "minProperties":
            return Sentence("schema-fields-too-few", "has {count} of at least {least} fields", count=len(value), least=wanted)
        case "maxProperties":
            return Sentence(
                "schema-fields-too-many", "has {count} fields; at most {most} are allowed", count=len(value), most=wanted
            )
        case "minLength":
            return Sentence("schema-text-empty", "is an empty text")
        case "maxLength":
            return Sentence(
                "schema-text-too-long", "has {count} characters; at most {most} are allowed", count=len(value), most=wanted
            )
        case "pattern":
            return Sentence("schema-pattern-wrong", "is {value}; it must match {pattern}", value=shown, pattern=wanted)
        case "not":
            return Sentence("key-unknown", "is not allowed here")
    message = str(error.message)
    return message if len(message) <= 300 else f"{message[:120]} ... {message[-120:]}"
