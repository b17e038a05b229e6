"""Tests of jobs whose request is strict: warnings of the scene are errors."""

import pytest

from renderer.errors import SettingsError
from renderer.scene.studio import NO_LIGHTS_WARNING, WEAK_LIGHTS_WARNING
from renderer.sentences import Sentence
from service.intake.resolve import resolve
from service.store.models import Job, Scene
from tests.helpers import code_of


def test_strict_job_is_rejected_with_all_warnings():
    notes, warnings = [Sentence("several-files", "Several files.")], [Sentence("texture-missing", "A texture is missing.")]
    scene = Scene(notes=notes, info={"warnings": warnings})
    with pytest.raises(SettingsError, match=r"2 warnings into errors: Several files\. A texture is missing$") as error:
        resolve(Job(request={"strict": True}), scene, 1)
    assert error.value.field == "strict"
    said = error.value.args[0]
    assert (said.code, said.params["count"]) == ("strict-scene-warnings", 2)
    assert [each.code for each in said.params["warnings"].params.values()] == ["several-files", "texture-missing"]


@pytest.mark.parametrize("warning", [NO_LIGHTS_WARNING, WEAK_LIGHTS_WARNING])
def test_requested_environment_clears_light_warning(warning):
    scene = Scene(notes=[], info={"warnings": [warning]})
    request = {"strict": True, "environment": {"color": [1, 1, 1]}, "width": 64, "height": 64}
    with pytest.raises(SettingsError) as error:
        resolve(Job(request=request), scene, 1)
    assert code_of(error.value) == "frame-pixels-too-many"
    with pytest.raises(SettingsError) as error:
        resolve(Job(request={"strict": True}), scene, 1)
    assert code_of(error.value) == "strict-scene-warning"
