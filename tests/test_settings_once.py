"""Tests that a render setting is declared once; the command, the API, scene files and the page derive it from there."""

from __future__ import annotations

import json
import runpy
from dataclasses import dataclass
from typing import Annotated, Any

import pytest
import typer
from pydantic import ValidationError
from typer.testing import CliRunner

from protocol import reproduce
from protocol.reproduce import sample_command
from rayfarm import picture
from renderer.errors import SettingsError
from renderer.scene.readers.yaml.schema import SCENE_SETTINGS, filled_in, schema
from renderer.sentences import Sentence
from renderer.setting_declaration import Choices, DeclaredSetting, Setting, SettingTexts, table
from renderer.setting_docs import described
from renderer.settings import OPTIONAL, RenderSettings, View
from service.models.declared import with_fields
from service.models.jobs import JobIn
from tests.helpers import ROOT, code_of

VIEW = View((0, 1, 5), (0, 1, 0))
SHAPES = Choices({"star": SettingTexts("Star", "Six points."), "dot": SettingTexts("Dot")})


@dataclass(frozen=True)
class Snowy(RenderSettings):
    """Render settings with two additional settings, which all interfaces must offer without further changes."""

    glitter: Annotated[
        float,
        Setting(0.1, 2.0, off=0.0),
        SettingTexts(
            "Glitter",
            "How much the snow sparkles.",
            integrators=("path",),
            off=Sentence("setting-off-none", "dull"),
            option="sparkle",
        ),
    ] = 0.0
    flake: Annotated[str, Setting(choices=SHAPES), SettingTexts("Flake", "Its shape.", group="lab", section="Samples")] = "star"


ALL = table(Snowy)
MORE: dict[str, DeclaredSetting] = {name: ALL[name] for name in ("glitter", "flake")}


def test_renderer_checks_a_new_setting() -> None:
    assert Snowy(8, 8, VIEW, glitter=1).glitter == 1.0
    assert Snowy.from_json(json.loads(json.dumps(Snowy(8, 8, VIEW, flake="dot").to_json()))) == Snowy(8, 8, VIEW, flake="dot")
    with pytest.raises(SettingsError, match=r"^glitter is 0.05; it lies between 0.1 and 2, or is 0: dull$") as error:
        Snowy(8, 8, VIEW, glitter=0.05)
    assert (error.value.field, code_of(error.value)) == ("glitter", "setting-out-of-range-or-off")
    with pytest.raises(SettingsError, match=r"^flake is 'ball'; known are star, dot$") as error:
        Snowy(8, 8, VIEW, flake="ball")
    assert (error.value.field, code_of(error.value)) == ("flake", "setting-value-unknown")


def test_command_has_an_option_for_a_new_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture, "SETTINGS_OPTIONS", {**picture.SETTINGS_OPTIONS, **MORE})
    found: list[picture.Picture] = []
    app = typer.Typer()

    @app.command()
    @picture.takes_picture
    def command(picture: picture.Picture = picture.Picture()) -> None:
        found.append(picture)

    done = CliRunner().invoke(app, ["--sparkle=0.5", "--flake=dot"])
    assert done.exit_code == 0, done.output
    assert (found[0].given_settings()["glitter"], found[0].given_settings()["flake"]) == (0.5, "dot")
    assert found[0].request([{"name": "c", "view": {}}])["glitter"] == 0.5
    said = " ".join(CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200", "TERM": "dumb"}).output.split())
    assert "How much the snow sparkles. 0.1 to 2; 0: dull." in said
    assert "Its shape: star (default), dot." in said


def test_api_accepts_a_new_setting() -> None:
    model: Any = with_fields(MORE, of_scene=True)(JobIn)
    assert model(scene="s", glitter=0.5, flake="dot").model_dump()["glitter"] == 0.5
    assert model(scene="s").glitter is None, "the scene file is asked first"
    for wrong in ({"glitter": 0.05}, {"glitter": 3}, {"flake": "ball"}, {"glitter": "much"}):
        with pytest.raises(ValidationError):
            model(scene="s", **wrong)
    shown = model.model_json_schema()["properties"]
    assert {"type": "number", "minimum": 0.0, "maximum": 2.0} in shown["glitter"]["anyOf"]
    assert shown["glitter"]["description"].startswith("How much the snow sparkles.")
    assert shown["flake"]["enum"] == ["star", "dot", None]


def test_scene_files_and_guide_have_a_new_setting() -> None:
    settings = filled_in(schema(), {**SCENE_SETTINGS, **MORE})["properties"]["settings"]["properties"]
    assert settings["glitter"] == {
        "description": "How much the snow sparkles.",
        "type": "number",
        "minimum": 0,
        "maximum": 2,
    }
    made = runpy.run_path(str(ROOT / "docs" / "settings_table.py"))
    text = made["schema_text"]({**SCENE_SETTINGS, **MORE})
    assert json.loads(text)["properties"]["settings"]["properties"] == settings
    guide = made["guide_text"]((ROOT / "docs" / "scene-format-settings.md").read_text(), {**SCENE_SETTINGS, **MORE})
    assert "| `glitter` | `0` | How much the snow sparkles. Takes 0.1 to 2; 0: dull. Of `path`. |" in guide


def test_page_receives_a_new_setting() -> None:
    """The description of settings that the page receives contains an added setting.

    tests/e2e/test_settings_form.py tests the setting's field in the form.
    """
    told = {each["name"]: each for each in json.loads(json.dumps(described(ALL)))["settings"]}
    assert told["glitter"]["off"] == {"value": 0, "label": "dull"}
    assert told["glitter"]["integrators"] == ["path"]
    assert told["glitter"]["option"] == "--sparkle"
    assert told["flake"]["choices"] == [
        {"name": "star", "label": "Star", "help": "Six points."},
        {"name": "dot", "label": "Dot", "help": ""},
    ]


def test_failing_batch_command_has_a_new_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduce, "SETTINGS", ALL)
    monkeypatch.setattr(reproduce, "OPTIONAL", (*OPTIONAL, *MORE))
    assert "--sparkle=0.25 --flake=dot" in sample_command(Snowy(8, 8, VIEW, glitter=0.25, flake="dot"), 1, 2, 3)


def test_every_setting_is_described() -> None:
    """Every render setting has a description in whole sentences; its choices of integrators and projections exist."""
    told = described()
    integrators = {choice["name"] for choice in next(s for s in told["settings"] if s["name"] == "integrator")["choices"]}
    projections = {choice["name"] for choice in next(s for s in told["view"] if s["name"] == "projection")["choices"]}
    for each in [*told["settings"], *told["view"], *told["work"]]:
        assert each["label"], each
        assert each["help"].endswith("."), each
        assert set(each["integrators"] or ()) <= integrators, each
        assert set(each["projections"] or ()) <= projections, each
        assert each["phrase"].count("{}") == 1, each
        assert all(choice["label"] and choice["help"].endswith(".") for choice in each["choices"] or ()), each
    names = [
        each["option"]
        for part in (told[name] for name in ("settings", "view", "work", "shot"))
        for each in part
        if each["name"] not in ("width", "height", "environment")
    ]
    assert len(names) == len(set(names)), "two settings have one option"
