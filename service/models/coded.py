"""Base of response models whose texts carry codes."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field, model_validator

from renderer.sentences import codes_of

__all__ = ["Coded"]


class Coded(BaseModel):
    """Base of models with fields that may be coded sentences: `codes` contains their codes and parameters."""

    codes: dict[str, Any] = Field(
        default_factory=dict,
        description="by field: code and params of its sentence; of a list of sentences a list, with null for plain texts",
    )

    @model_validator(mode="before")
    @classmethod
    def _with_codes(cls, data: Any) -> Any:  # type: ignore[operator,unused-ignore]
        return {**data, "codes": codes_of(data)} if isinstance(data, dict) and "codes" not in data else data
