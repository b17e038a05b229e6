"""Tests of jobs with a strict request: warnings of the scene are errors."""

import pytest

from renderer.errors import SettingsError
from service.intake.resolve import resolve
from service.store.models import Job, Scene


def test_a_strict_job_is_refused_with_all_warnings():
    scene = Scene(notes=["Several files."], info={"warnings": ["A texture is missing."]})
    with pytest.raises(SettingsError, match=r"2 warnings into errors: Several files\. A texture is missing$"):
        resolve(Job(request={"strict": True}), scene, 1)


def test_light_of_its_own_is_no_guess():
    studio = "The scene has no light: lit by a soft studio light. Give an environment to change that."
    scene = Scene(notes=[], info={"warnings": [studio]})
    request = {"strict": True, "environment": {"color": [1, 1, 1]}, "width": 64, "height": 64}
    with pytest.raises(SettingsError, match=r"^width x height"):
        resolve(Job(request=request), scene, 1)
    with pytest.raises(SettingsError, match="strict turns the scene's warning into an error"):
        resolve(Job(request={"strict": True}), scene, 1)
