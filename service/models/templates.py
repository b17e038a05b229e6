"""Request for a job by a job template of Open Job Description."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from service.models.queue import QueueOptionsIn

__all__ = ["TemplateIn"]

Parameters = dict[Annotated[str, Field(max_length=64)], Annotated[str, Field(max_length=1024)] | int | float]


class TemplateIn(QueueOptionsIn):
    """A job template whose tasks call `rayfarm render`, and the uploaded scene that it renders."""

    scene: str = Field(description="id of the scene; the path of the template's scene is not read", max_length=100)
    template: dict[str, Any] = Field(description="a template of the specification 2023-09, as JSON")
    parameters: Parameters = Field(
        default_factory=dict, max_length=50, description="values of the template's parameters by name, such as Frames: 1-250:5"
    )
    step: str | None = Field(
        None,
        max_length=64,
        description="of the template, by name, if it has several; `after` then has the jobs of the steps on which it depends",
    )
    environment: str | None = Field(
        None, max_length=100, description="id of an uploaded environment, in place of the file of --env in the template"
    )
    priority: int = Field(0, ge=-100, le=100, description="higher is sooner")
    fresh: bool = Field(False, description="whether to render from the first sample, without reusing samples of earlier jobs")
