"""Base model of request bodies."""

from __future__ import annotations

from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

from renderer.sentences import Sentence

__all__ = ["Strict"]


class Strict(BaseModel):
    """Request body in which unknown fields are an error, so that a misspelt option is not ignored."""

    model_config = ConfigDict(extra="forbid")

    @field_validator("*", mode="before")
    @classmethod
    def _reject_booleans(cls, value: Any, field: ValidationInfo) -> Any:
        """Rejects booleans for numeric fields, where Pydantic would otherwise convert them to 0 and 1."""
        kind = None if field.field_name is None else cls.model_fields[field.field_name].annotation
        if kind in (bool, bool | None) or Literal[False] in get_args(kind):
            return value
        if isinstance(value, bool) or (isinstance(value, list) and any(isinstance(each, bool) for each in value)):
            raise ValueError(
                Sentence("boolean-not-allowed", "this field does not take true or false; see the API's description for its type")
            )
        return value
