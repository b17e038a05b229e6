"""The settings form by itself: it asks for what renderer/settings.py knows, and only for what differs from the scene's own."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Page, expect

from renderer import settings
from tests.e2e.site import call

pytestmark = pytest.mark.browser

SCENE = {
    "id": "abc",
    "name": "A scene",
    "cameras": [
        {"name": "front", "view": {"eye": [0.123456789, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40}},
        {"name": "auto", "view": {"eye": [0, 2, 9], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 30}},
    ],
    "defaults": {"width": 300, "height": 200, "spp": 50, "max_depth": 5, "roulette": 0.8},
}


def open_form(page: Page) -> None:
    body = """
        window.asked = null;
        const form = m.settingsForm(a, async (request) => { window.asked = request; });
        document.body.replaceChildren(form.element);
        for (const fold of document.querySelectorAll("details")) fold.open = true;"""
    call(page, "settings-form", body, SCENE)


def submitted(page: Page) -> dict[str, Any]:
    page.get_by_role("button", name="Render").click()
    asked: dict[str, Any] = page.evaluate("window.asked")
    return asked


def test_the_choices_are_the_renderers(page: Page) -> None:
    names = """
        const lists = Object.entries(m).filter(([, list]) => Array.isArray(list));
        return Object.fromEntries(lists.map(([name, list]) => [name, list.map((choice) => choice.name)]));"""
    assert call(page, "render-choices", names) == {
        name: list(getattr(settings, name))
        for name in ("INTEGRATORS", "SAMPLERS", "FILTERS", "SAMPLINGS", "HEURISTICS", "LIGHT_CHOICES", "PROJECTIONS", "MISTAKES")
    }
    fields = settings.RenderSettings.__dataclass_fields__
    for name, value in call(page, "render-choices", "return m.DEFAULTS;").items():
        assert fields[name].default == (tuple(value) if isinstance(value, list) else value), name


def test_what_is_left_alone_is_the_scenes_own(page: Page) -> None:
    open_form(page)
    plain = {"scene": "abc", "camera": "front", "width": 300, "height": 200, "spp": 50, "seed": 0}
    assert submitted(page) == {**plain, "environment": {"strength": 1}}


def test_a_pictures_settings_are_asked_for_again(page: Page) -> None:
    """All that a finished job was rendered with, but what is the scene's own anyway."""
    view = settings.View((0.1, 2, 3), (0, 0.5, 0), fov=33, aperture=0.02, focus=2.5)
    chosen = {"seed": 7, "integrator": "direct", "sampling": "bsdf", "light_samples": 3, "filter": "tent"}
    light = {"environment": (0.123456, 2.0, 0.5), "environment_strength": 0.7}
    rendered = settings.RenderSettings(640, 320, view, max_depth=5, roulette=0.8, **chosen, **light)  # type: ignore[arg-type]
    job = {"settings": rendered.to_json(), "spp": 21, "noise": None, "seconds": 90}
    body = """
        window.asked = null;
        const form = m.settingsForm(a.scene, async (request) => { window.asked = request; }, a.job);
        document.body.replaceChildren(form.element);"""
    call(page, "settings-form", body, {"scene": SCENE, "job": job})
    asked = submitted(page)
    assert settings.View.from_json(asked.pop("view")) == view
    size = {"scene": "abc", "width": 640, "height": 320, "spp": 21, "seconds": 90}
    assert asked == {**size, **chosen, "environment": {"color": [0.123456, 2.0, 0.5], "strength": 0.7}}


def test_what_is_changed_is_asked_for(page: Page) -> None:
    open_form(page)
    page.get_by_label("Aperture").fill("0.1")
    page.get_by_label("Finding lights").select_option("light")
    page.get_by_label("Sampler").select_option("independent")
    page.get_by_label("Light samples").fill("4")
    page.get_by_label("Roulette").fill("0.5")
    page.get_by_label("Light from around").select_option("sky")
    asked = submitted(page)
    # The exact numbers of the scene's camera stay, though the fields show six digits of them.
    assert asked["view"]["eye"] == SCENE["cameras"][0]["view"]["eye"]  # type: ignore[index]
    assert asked["view"]["aperture"] == 0.1
    assert asked["view"]["focus"] is None
    assert "camera" not in asked
    assert (asked["sampling"], asked["sampler"], asked["light_samples"], asked["roulette"]) == ("light", "independent", 4, 0.5)
    assert asked["environment"] == {"strength": 1, "sky": {"elevation": 35, "azimuth": 0}}
    settings.View.from_json(asked["view"])


def test_what_the_scene_asks_for_can_be_taken_back(page: Page) -> None:
    open_form(page)
    page.get_by_label("Roulette").fill("")
    page.get_by_label("Least chance").fill("0.15")
    page.get_by_label("Weighed by").select_option("balance")
    page.get_by_label("Choice among lights").select_option("uniform")
    asked = submitted(page)
    assert (asked["roulette"], asked["roulette_floor"]) == (0, 0.15)
    assert (asked["heuristic"], asked["light_choice"]) == ("balance", "uniform")


def test_only_what_an_integrator_reads_is_shown_and_sent(page: Page) -> None:
    open_form(page)
    expect(page.get_by_label("AO distance")).to_be_hidden()
    page.get_by_label("Max depth").fill("9")
    page.get_by_label("Integrator").select_option("ao")
    expect(page.get_by_label("Max depth")).to_be_hidden()
    page.get_by_label("AO distance").fill("2.5")
    asked = submitted(page)
    assert asked["integrator"] == "ao"
    assert asked["ao_distance"] == 2.5
    assert "max_depth" not in asked


def test_whitteds_constant_is_a_grey_and_a_mistake_is_asked_for_by_name(page: Page) -> None:
    open_form(page)
    expect(page.get_by_label("Ambient light")).to_be_hidden()
    page.get_by_label("Integrator").select_option("whitted")
    expect(page.get_by_label("Finding lights")).to_be_hidden()
    page.get_by_label("Ambient light").fill("0.1")
    page.get_by_label("Mistake on purpose").select_option("attenuation")
    page.get_by_label("Near plane").fill("1.5")
    asked = submitted(page)
    assert (asked["integrator"], asked["ambient"], asked["mistake"]) == ("whitted", [0.1, 0.1, 0.1], "attenuation")
    assert asked["view"]["near"] == 1.5


def test_a_panorama_is_twice_as_wide_as_high(page: Page) -> None:
    open_form(page)
    page.get_by_label("Projection").select_option("panorama")
    expect(page.get_by_label("Aperture")).to_be_hidden()
    asked = submitted(page)
    assert (asked["width"], asked["height"]) == (300, 150)
    assert asked["view"]["projection"] == "panorama"


def test_what_cannot_be_is_said_beside_its_field(page: Page) -> None:
    open_form(page)
    page.get_by_label("Roulette").fill("7")
    page.get_by_label("Max depth").fill("2.5")
    page.get_by_label("Samples per pixel").fill("")
    assert submitted(page) is None
    for sentence in ("Roulette lies between 0.05 and 1.", "Max depth is a whole number.", "Samples per pixel needs a number."):
        expect(page.get_by_role("alert").filter(has_text=sentence)).to_be_visible()
    expect(page.get_by_label("Samples per pixel")).to_be_focused()
    page.get_by_label("Samples per pixel").fill("8")
    page.get_by_label("Max depth").fill("2")
    page.get_by_label("Roulette").fill("")
    assert submitted(page)["spp"] == 8
