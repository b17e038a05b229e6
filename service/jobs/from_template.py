"""Requests for jobs made from job templates of Open Job Description."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from renderer.errors import SettingsError
from renderer.sentences import Sentence, with_full_stop
from service.access.visit import Visit
from service.errors import Invalid, Unavailable
from service.farm import Farm
from service.intake.job_template import has_model, read_call
from service.intake.render_words import request_fields
from service.jobs.create import check_scene
from service.models.jobs import JobIn
from service.models.templates import TemplateIn
from service.store.models import Scene

__all__ = ["request_of"]

FOLDER = Path("/template")  # completes relative paths; nothing is read there


def request_of(asked: TemplateIn, visit: Visit, farm: Farm) -> JobIn:
    """Returns the request for the job that a template stands for.

    Raises NotFound, NotAllowed, Unavailable without the package openjd-model, Invalid that names the part of the template for
    which a farm has no counterpart, and ValidationError for values that no job can have.
    """
    if not has_model():
        raise Unavailable(
            Sentence(
                "templates-not-offered",
                "This farm reads no job templates: its service lacks the package openjd-model. Ask the "
                "administrator of this farm.",
            )
        )
    check_scene(asked.scene, visit, farm)
    try:
        call = read_call(asked.template, asked.parameters, FOLDER, FOLDER, free_paths=True, step=asked.step)
        fields = request_fields(call.words, _cameras(asked.scene, farm), asked.environment)
    except SettingsError as error:
        raise Invalid(with_full_stop(error), field=error.field or "template") from None
    if call.frames is not None:
        fields["frames"] = call.frames
    queue = asked.model_dump(include={"scene", "after", "max_slots", "deadline", "priority", "fresh"})
    return JobIn.model_validate({**queue, **fields, "name": call.name, "needs": [*asked.needs, *call.needs]})


def _cameras(scene: str, farm: Farm) -> list[dict[str, Any]] | None:
    """Returns the cameras of a scene; None while it is not prepared."""
    with farm.sessions() as session:
        row = session.get(Scene, scene)
        return (row.info or {}).get("cameras") or [] if row is not None and row.status == "ready" else None
