"""Sentences with codes for the validation errors of Pydantic, whose own messages are English only.

The English texts are Pydantic's, in lower case.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from renderer.sentences import Sentence

__all__ = ["coded_validation_message"]

_TYPES: dict[str, str] = {
    "missing": Sentence("value-missing", "field required"),
    "bool_type": Sentence("value-not-boolean", "input should be a valid boolean"),
    "bool_parsing": Sentence("value-not-boolean-text", "input should be a valid boolean, unable to interpret input"),
    "int_type": Sentence("value-not-integer", "input should be a valid integer"),
    "int_parsing": Sentence("value-not-integer-text", "input should be a valid integer, unable to parse string as an integer"),
    "int_parsing_size": Sentence("value-integer-too-large", "input should be a valid integer, but has too many digits"),
    "int_from_float": Sentence("value-has-fraction", "input should be a valid integer, got a number with a fractional part"),
    "float_type": Sentence("value-not-number", "input should be a valid number"),
    "float_parsing": Sentence("value-not-number-text", "input should be a valid number, unable to parse string as a number"),
    "finite_number": Sentence("value-not-finite", "input should be a finite number"),
    "string_type": Sentence("value-not-text", "input should be a valid string"),
    "string_unicode": Sentence("value-not-unicode", "input should be a valid string in Unicode"),
    "list_type": Sentence("value-not-list", "input should be a valid list"),
    "tuple_type": Sentence("value-not-tuple", "input should be a valid tuple"),
    "dict_type": Sentence("value-not-dictionary", "input should be a valid dictionary"),
    "none_required": Sentence("value-not-null", "input should be null"),
}


def coded_validation_message(error: Mapping[str, Any]) -> str | None:
    """Returns the translatable sentence for one of Pydantic's validation errors; None if this type of error has none.

    error: with the keys `type` and `ctx`, as Pydantic lists errors.
    """
    context = error.get("ctx", {})
    match error["type"]:
        case "greater_than":
            return Sentence("value-not-greater", "input should be greater than {limit}", limit=_number(context["gt"]))
        case "greater_than_equal":
            return Sentence("value-too-small", "input should be greater than or equal to {limit}", limit=_number(context["ge"]))
        case "less_than":
            return Sentence("value-not-less", "input should be less than {limit}", limit=_number(context["lt"]))
        case "less_than_equal":
            return Sentence("value-too-large", "input should be less than or equal to {limit}", limit=_number(context["le"]))
        case "string_too_short":
            return Sentence("text-too-short", "input should have at least {least} characters", least=context["min_length"])
        case "string_too_long":
            return Sentence("text-too-long", "input should have at most {most} characters", most=context["max_length"])
        case "string_pattern_mismatch":
            return Sentence("text-pattern-wrong", "input should match the pattern {pattern}", pattern=context["pattern"])
        case "too_short":
            return Sentence("list-too-short", "input should have at least {least} items", least=context["min_length"])
        case "too_long":
            return Sentence("list-too-long", "input should have at most {most} items", most=context["max_length"])
        case "literal_error" | "enum":
            return Sentence("value-not-among", "input should be one of {choices}", choices=_choices(str(context["expected"])))
        case kind:
            return _TYPES.get(kind)


def _number(limit: Any) -> Any:
    return int(limit) if isinstance(limit, float) and limit.is_integer() else limit


def _choices(expected: str) -> list[str]:
    """Returns the names in a text such as "'a', 'b' or 'c'"."""
    return re.findall(r"'([^']*)'", expected) or [expected]
