"""Tests of the form of render settings: it has every setting of renderer/settings.py.

It requests only values that differ from the scene's own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import pytest
from playwright.sync_api import Page, expect

from renderer import settings
from renderer.setting_declaration import DeclaredSetting, Setting, SettingTexts, table
from renderer.setting_docs import described
from tests.e2e.site import call

SCENE = {
    "id": "abc",
    "name": "A scene",
    "cameras": [
        {"name": "front", "view": {"eye": [0.123456789, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40}},
        {"name": "auto", "view": {"eye": [0, 2, 9], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 30}},
    ],
    "defaults": {"width": 300, "height": 200, "spp": 50, "max_depth": 5, "roulette": 0.8},
}


# Loads the settings table, from which a form is built.
TOLD = "(await import('/js/news/settings-table.js')).table.set(a.table);"


def open_form(
    page: Page,
    known: Mapping[str, DeclaredSetting] = settings.SETTINGS,
    scene: Mapping[str, object] = SCENE,
    as_shot: bool = False,
) -> None:
    body = """
        window.asked = null;
        const form = m.settingsForm(a.scene, async (request) => { window.asked = request; }, null, a.asShot);
        window.form = form;
        document.body.replaceChildren(form.element);
        for (const fold of document.querySelectorAll("details")) fold.open = true;"""
    call(page, "scene/settings-form", TOLD + body, {"scene": scene, "table": described(known), "asShot": as_shot})


def submitted_request(page: Page) -> dict[str, Any]:
    page.get_by_role("button", name="Render").click()
    asked: dict[str, Any] = page.evaluate("window.asked")
    return asked


@dataclass(frozen=True)
class Sparkling(settings.RenderSettings):
    """Render settings with the additional setting `sparkle`, which the form must show without a change of the page."""

    sparkle: Annotated[
        float,
        Setting(0.1, 2.0, off=0.0),
        SettingTexts(
            "Sparkle",
            "How much the snow glitters.",
            group="advanced",
            integrators=("path", "ao"),
            off="dull",
            phrase="glitter {}",
        ),
    ] = 0.0


@pytest.mark.long
def test_declared_setting_has_a_field(page: Page) -> None:
    open_form(page, table(Sparkling))
    field = page.get_by_label("Sparkle")
    expect(field).to_have_attribute("placeholder", "dull")
    expect(field).to_have_attribute("aria-description", "How much the snow glitters.")  # also its tooltip
    field.fill("3")
    assert submitted_request(page) is None
    expect(page.get_by_text("Sparkle lies between 0.1 and 2.")).to_be_visible()
    field.fill("1.5")
    assert submitted_request(page)["sparkle"] == 1.5
    page.get_by_label("Integrator").select_option("direct")
    expect(field).to_be_hidden()
    assert "sparkle" not in submitted_request(page)


@pytest.mark.long
def test_quality_presets_show_expected_time_and_noise(page: Page) -> None:
    """Each quality preset shows the time and the noise that are expected for it.

    Both follow from the scene's latest picture, which took a microsecond of one slot per sample of a pixel, and had a noise of
    0.4 at one sample per pixel.
    """
    call(page, "news/farm", "m.workers.set([{ slots: 2, samples_per_s: 1 }]);")
    scene = {**SCENE, "defaults": {"width": 1000, "height": 1000}, "measured": {"sample_s": 1e-6, "noise": 0.4, "pace": 1}}
    open_form(page, scene=scene)
    choices = page.get_by_role("radiogroup", name="Quality").locator(".quality").all()
    assert [[*(part.text_content() for part in each.locator("span").all()), each.get_attribute("title")] for each in choices] == [
        ["Draft", "~10 s", "16 samples · 10 % noise"],
        ["Good", "~30 s", "64 samples · 5 % noise"],
        ["Final", "~2 min", "256 samples · 3 % noise"],
        ["Finest", "~10 min", "1024 samples · 1 % noise"],
        ["Custom", "~30 s", "64 samples · 5 % noise"],
    ]
    expect(page.get_by_text("About 30 s", exact=True)).to_have_attribute("title", "64 M samples, 2 slots, 5 % noise")
    page.get_by_text("Finest").click()
    assert submitted_request(page)["spp"] == 1024
    call(page, "news/farm", "m.jobs.set([{ id: 'j', state: 'running' }]);")
    open_form(page, scene=scene)
    expect(page.get_by_text("About 30 s, longer while another picture is rendered")).to_be_visible()
    open_form(page, scene={**scene, "measured": None})
    page.evaluate("window.form.measure(1e-6)")
    expect(page.get_by_text("Takes 30 s to 1 min, longer while another picture is rendered")).to_be_visible()


@pytest.mark.long
def test_changed_field_is_marked_and_can_be_reset(page: Page) -> None:
    open_form(page)
    depth = page.get_by_label("Max depth", exact=True)
    back = page.get_by_role("button", name="Reset to 5")
    expect(back).to_be_hidden()
    depth.locator("xpath=..").locator("input[type=range]").fill("400")  # end of the slider
    expect(depth).to_have_value("64")
    assert submitted_request(page)["max_depth"] == 64
    back.click()
    expect(depth).to_have_value("5")
    expect(back).to_be_hidden()
    assert "max_depth" not in submitted_request(page)
    page.get_by_label("Filter").select_option("box")
    page.get_by_role("button", name="Reset to Blackman-Harris").click()
    assert "filter" not in submitted_request(page)


@pytest.mark.long
def test_comparison_lists_differences_of_settings(page: Page) -> None:
    """The comparison lists each difference of two jobs' settings with the values of both.

    Among them are a setting that is off, a choice, samples against a noise level, and the camera.
    """
    view = {"eye": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40, "projection": "perspective", "focus": None}
    a = {"name": "Snow", "state": "finished", "width": 8, "height": 8, "spp": 64, "noise": None}
    common = {"clamp_indirect": 0.0, "view": view, "environment": None}
    left = {**a, "settings": {**common, "integrator": "path", "sparkle": 0.0, "seed": 0}}
    right = {**a, "noise": 0.025, "settings": {**left["settings"], "integrator": "ao", "sparkle": 1.23456, "seed": 7}}
    right["environment"] = {"color": [1, 0.5, 0.25], "rotation": 30, "strength": 2}
    right["settings"]["view"] = {**view, "focus": 2.0, "eye": [0.1, 0, 5]}
    jobs = {"left": left, "right": right, "table": described(table(Sparkling))}
    rows = call(page, "compare/job-differences", TOLD + "return m.differences(a.left, a.right);", jobs)
    assert [(row["label"], row["a"], row["b"]) for row in rows] == [
        ("Environment light", "The scene's own", "One colour, #ffbc89, turned by 30°, strength 2"),
        ("Integrator", "Path tracing", "Ambient occlusion"),
        ("Seed", "0", "7"),
        ("Sparkle", "dull", "1.235"),
        ("Samples per pixel", "64 samples", "noise 2.5 %"),
        ("Camera position", "x\u00a00, y\u00a00, z\u00a05", "x\u00a00.1, y\u00a00, z\u00a05"),
        ("Focus distance", "the target's", "2"),
    ]
    body = (
        TOLD
        + """
        const side = (job) => ({ job, channel: "" });
        return m.sideNames(side(a.left), side(a.right));"""
    )
    assert call(page, "compare/job-differences", body, jobs) == [
        "light of the file, Path tracing",
        "One colour, #ffbc89, turned by 30°, strength 2, Ambient occlusion",
    ]


@pytest.mark.long
def test_comparison_lists_differences_of_scene_versions(page: Page) -> None:
    """The comparison of two jobs also lists what was changed in the scene between them: variant and environment.

    For jobs of an older release, the difference is found in their two scenes, which have the same name; newer jobs store it
    themselves.
    """
    view = {"eye": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40, "projection": "perspective", "focus": None}
    job = {"name": "shoe", "width": 8, "height": 8, "spp": 64, "settings": {"integrator": "path", "view": view}}
    own = {"id": "a", "variants": ["beach", "night", "night"], "variant": None, "environment": None}
    others = [{**own, "id": "b", "variant": "2", "environment": "sky:35,0"}, {**own, "id": "c", "variant": "beach"}]
    body = (
        TOLD
        + """
        (await import('/js/news/farm.js')).scenes.set(a.scenes);
        return m.differences({ ...a.job, scene: "a" }, { ...a.job, scene: a.other });"""
    )
    arguments = {"scenes": [own, *others], "job": job, "table": described()}
    told = [call(page, "compare/job-differences", body, {**arguments, "other": other}) for other in ("a", "b", "c")]
    asked = body.replace("scene: a.other", 'scene: "a", variant: "2", environment: { sky: { elevation: 35, azimuth: -90 } }')
    told.append(call(page, "compare/job-differences", asked, arguments))
    assert told == [
        [],
        [
            {"label": "Materials", "a": "as saved", "b": "night (2)"},
            {"label": "Environment light", "a": "The scene's own", "b": "Clear sky, sun at 35° elevation, 0°"},
        ],
        [{"label": "Materials", "a": "as saved", "b": "beach"}],
        [
            {"label": "Materials", "a": "as saved", "b": "night (2)"},
            {"label": "Environment light", "a": "The scene's own", "b": "Clear sky, sun at 35° elevation, 270°"},
        ],
    ]


@pytest.mark.long
def test_job_goal_is_shown_instead_of_sample_limit(page: Page) -> None:
    ends = {
        "512 samples": {"spp": 512, "noise": None, "seconds": None},
        "noise 7 %": {"spp": 16384, "noise": 0.07, "seconds": None},
        "2.5 s": {"spp": 1 << 20, "noise": None, "seconds": 2.5},
        "": {"spp": None},
    }
    body = TOLD + "return a.ends.map((end) => m.endOf(end));"
    assert call(page, "news/settings-table", body, {"ends": list(ends.values()), "table": described()}) == list(ends)


@pytest.mark.long
def test_unchanged_fields_use_scene_defaults(page: Page) -> None:
    open_form(page)
    plain = {"scene": "abc", "camera": "front", "width": 300, "height": 200, "spp": 50}
    assert submitted_request(page) == plain


@pytest.mark.long
def test_cameras_with_equal_names_are_distinguished(page: Page) -> None:
    """Cameras with the same name can be selected separately: the first is requested by name, the others by number."""
    front, auto = SCENE["cameras"]  # type: ignore[misc]
    open_form(page, scene={**SCENE, "cameras": [front, {**front, "name": "side"}, front, {**front, "name": "auto"}, auto]})
    camera = page.get_by_label("Camera", exact=True)
    own = [f"{name}, from the file" for name in ("front (1)", "side", "front (2)", "auto (1)")]
    shown = [*own, "Automatic: frames the scene"]
    sides = ["From the front", "From the back", "From the left", "From the right", "From above"]
    expect(camera.get_by_role("option")).to_have_text([*shown, *sides, "Custom view …"])
    for label, asked in zip(shown, ["front", "side", 2, "auto", 4], strict=False):
        camera.select_option(label=label)
        assert submitted_request(page)["camera"] == asked


@pytest.mark.long
def test_scene_page_has_its_form_while_scene_is_prepared(page: Page) -> None:
    """The fields are in place, disabled, and the preparation's progress is over the view."""
    scene = {
        **SCENE,
        "status": "preparing",
        "progress": 0.05,
        "step": "reading",
        "cameras": [],
        "counts": {},
        "warnings": [],
        "main": "a.obj",
    }
    body = """
        const farm = await import('/js/news/farm.js');
        farm.scenes.set([a.scene]);
        document.body.replaceChildren(m.sceneView(a.scene.id).element);"""
    call(page, "views/scene", TOLD + body, {"scene": scene, "table": described(settings.SETTINGS)})
    expect(page.get_by_label("Camera", exact=True)).to_be_disabled()
    expect(page.get_by_label("Up axis", exact=True)).to_be_disabled()
    expect(page.get_by_role("button", name="Render", exact=True)).to_be_disabled()
    expect(page.locator(".view-pills").get_by_role("listitem").filter(has_text="Read")).to_have_attribute("aria-current", "step")


@pytest.mark.long
def test_image_dropped_while_scene_is_prepared_lights_it(page: Page) -> None:
    added = {"id": "e", "name": "porch.exr", "help": "", "kind": "image", "environment": {"image": "e"}, "thumbnail": ""}
    page.route("**/api/environments*", lambda route: route.fulfill(json=added if route.request.method == "POST" else [added]))
    page.evaluate("document.body.innerHTML = '<div id=tray></div><div id=announcer></div><div id=upload-place></div>';")
    ready = {**SCENE, "status": "ready", "counts": {}, "bytes": 1, "warnings": [], "main": "a.obj"}
    body = """
        const farm = await import('/js/news/farm.js');
        const { offerLight } = await import('/js/shell/light-drop.js');
        farm.scenes.set([{ ...a.scene, status: "preparing" }]);
        document.body.replaceChildren(m.sceneView(a.scene.id).element);
        offerLight([new File(["x"], "porch.exr")]);
        farm.scenes.set([a.scene]);"""
    call(page, "views/scene", TOLD + body, {"scene": ready, "table": described(settings.SETTINGS)})
    expect(page.get_by_role("radio", name="porch")).to_be_checked()


@pytest.mark.long
def test_side_is_requested_as_view(page: Page) -> None:
    open_form(page, scene={**SCENE, "bounds": [[-1, -1, -1], [1, 1, 1]]})
    page.get_by_label("Camera", exact=True).select_option(label="From the front")
    asked = submitted_request(page)
    eye, target = asked["view"]["eye"], asked["view"]["target"]
    assert "camera" not in asked and eye[2] > 1 and [*eye[:2], *target[:2]] == pytest.approx([0, 0, 0, 0])


@pytest.mark.long
def test_several_scenes_are_a_choice_and_no_warning(page: Page) -> None:
    """An upload with several scenes has a choice of its files; its other warnings are one line that opens."""
    several = {"code": "scene-files-several", "params": {"file": "a.obj", "others": ["b.obj"]}}
    scene = {**SCENE, "warnings": ["Several scene files.", "One.", "Two."], "codes": {"warnings": [several, None, None]}}
    open_form(page, scene=scene)
    expect(page.get_by_label("File", exact=True).get_by_role("option")).to_have_text(["a.obj", "b.obj"])
    call(page, "scene/scene-notices", "document.body.replaceChildren(m.warnings(a));", scene)
    page.get_by_text("2 warnings").click()
    expect(page.get_by_role("list", name="Warnings").get_by_role("listitem")).to_have_text(["One.", "Two."])


@pytest.mark.long
def test_missing_files_come_first_and_guesses_are_notes(page: Page) -> None:
    """The line of a scene's warnings begins with the missing files; a scene of which nothing is lost has notes."""
    guess = {"code": "obj-image-guessed", "params": {"file": "a.obj", "image": "skin.png"}}
    missing = {"code": "texture-file-missing", "params": {"user": "Material wood", "texture": "oak.png"}}
    scene = {**SCENE, "warnings": ["Guessed.", "Other.", "Missing."], "codes": {"warnings": [guess, None, missing]}}
    call(page, "scene/scene-notices", "document.body.replaceChildren(m.warnings(a));", scene)
    expect(page.locator(".notice.warning .first-warning")).to_have_text("2 warnings Missing: oak.png")
    page.get_by_text("2 warnings").click()
    expect(page.get_by_role("list", name="Warnings").get_by_role("listitem")).to_have_text(["Missing.", "Other.", "Guessed."])
    scene = {**SCENE, "warnings": ["Guessed."], "codes": {"warnings": [guess]}}
    call(page, "scene/scene-notices", "document.body.replaceChildren(m.warnings(a));", scene)
    expect(page.locator(".notice.note .first-warning")).to_have_text("1 note The only image beside the file is its texture")
    page.get_by_text("1 note").click()
    expect(page.get_by_role("list", name="Warnings").get_by_role("listitem")).to_have_text(["Guessed."])
    nothing = {"code": "scene-without-area", "params": {}}
    scene = {**SCENE, "warnings": ["Nothing.", "Other."], "codes": {"warnings": [nothing, None]}}
    call(page, "scene/scene-notices", "document.body.replaceChildren(m.warnings(a));", scene)
    expect(page.locator(".notice.warning .first-warning")).to_have_text("1 warning")


@pytest.mark.long
def test_settings_of_finished_job_are_requested_again(page: Page) -> None:
    """The form for rendering a finished job again requests that job's settings, except those that equal the scene's own."""
    view = settings.View((0.1, 2, 3), (0, 0.5, 0), fov=33, aperture=0.02, focus=2.5)
    chosen = {"seed": 7, "integrator": "direct", "sampling": "bsdf", "light_samples": 3, "filter": "tent"}
    light = {"environment": (0.123456, 2.0, 0.5), "environment_strength": 0.7}
    rendered = settings.RenderSettings(640, 320, view, max_depth=5, roulette=0.8, **chosen, **light)  # type: ignore[arg-type]
    job = {"settings": rendered.to_json(), "spp": 21, "noise": None, "seconds": 90}
    body = """
        window.asked = null;
        const { startOfJob, startOfTake } = await import("/js/scene/form-start.js");
        const submit = async (request) => { window.asked = request; };
        const form = m.settingsForm(a.scene, submit, a.job && startOfJob(a.job));
        if (a.take) form.restore(startOfTake({ request: a.take }, form.request()));
        document.body.replaceChildren(form.element);"""
    given = {"scene": SCENE, "table": described()}
    call(page, "scene/settings-form", TOLD + body, {**given, "job": job})
    asked = submitted_request(page)
    call(page, "scene/settings-form", TOLD + body, {**given, "take": asked})
    restored = submitted_request(page)
    assert restored.pop("spp") != 21, "a take has no goals"
    assert restored == {name: value for name, value in asked.items() if name not in ("spp", "seconds")}
    assert settings.View.from_json(asked.pop("view")) == view
    size = {"scene": "abc", "width": 640, "height": 320, "spp": 21, "seconds": 90}
    assert asked == {**size, **chosen, "environment": {"color": [0.123456, 2.0, 0.5], "strength": 0.7}}


def test_changed_fields_are_requested(page: Page) -> None:
    open_form(page)
    page.get_by_label("Aperture").fill("0.1")
    page.get_by_label("Light samples").fill("4")
    page.get_by_label("Pixel filter").select_option("tent")
    page.get_by_role("radio", name="Clear sky").check(force=True)
    dial = page.get_by_role("slider", name="Sun position")
    dial.press("ArrowUp")
    dial.press("Shift+ArrowLeft")
    asked = submitted_request(page)
    # The scene camera's exact numbers are sent, though the fields show six digits.
    assert asked["view"]["eye"] == SCENE["cameras"][0]["view"]["eye"]  # type: ignore[index]
    assert asked["view"]["aperture"] == 0.1
    assert asked["view"]["focus"] is None
    assert "camera" not in asked
    assert (asked["light_samples"], asked["filter"]) == (4, "tent")
    assert asked["environment"] == {"sky": {"elevation": 51, "azimuth": 110}}
    settings.View.from_json(asked["view"])


@pytest.mark.long
def test_second_click_before_response_submits_nothing(page: Page) -> None:
    body = """
        let asked = 0;
        let answer;
        const form = m.settingsForm(a.scene, () => (asked++, new Promise((done) => (answer = done))));
        document.body.replaceChildren(form.element);
        form.element.requestSubmit();
        form.element.requestSubmit();
        const first = asked;
        answer();
        await new Promise((done) => setTimeout(done));
        form.element.requestSubmit();
        return [first, asked];"""
    assert call(page, "scene/settings-form", TOLD + body, {"scene": SCENE, "table": described(settings.SETTINGS)}) == [1, 2]


@pytest.mark.long
def test_only_settings_of_integrator_are_shown_and_sent(page: Page) -> None:
    open_form(page)
    expect(page.get_by_label("AO distance")).to_be_hidden()
    page.get_by_label("Max depth", exact=True).fill("9")
    page.get_by_label("Integrator").select_option("ao")
    expect(page.get_by_label("Max depth", exact=True)).to_be_hidden()
    page.get_by_label("AO distance").fill("2.5")
    asked = submitted_request(page)
    assert asked["integrator"] == "ao"
    assert asked["ao_distance"] == 2.5
    assert "max_depth" not in asked


@pytest.mark.long
def test_whitted_ambient_is_grey(page: Page) -> None:
    open_form(page)
    expect(page.get_by_label("Ambient light")).to_be_hidden()
    page.get_by_label("Integrator").select_option("whitted")
    expect(page.get_by_label("Light sampling")).to_have_count(0)  # only in the API and in files
    page.get_by_label("Ambient light").fill("0.1")
    page.get_by_label("Near plane").fill("1.5")
    page.get_by_label("Shift up").fill("0.25")
    asked = submitted_request(page)
    assert (asked["integrator"], asked["ambient"]) == ("whitted", [0.1, 0.1, 0.1])
    assert (asked["view"]["near"], asked["view"]["shift_y"]) == (1.5, 0.25)


@pytest.mark.long
def test_panorama_is_twice_as_wide_as_high(page: Page) -> None:
    open_form(page)
    page.get_by_label("Projection").select_option("panorama")
    expect(page.get_by_label("Aperture")).to_be_hidden()
    asked = submitted_request(page)
    assert (asked["width"], asked["height"]) == (300, 150)
    assert asked["view"]["projection"] == "panorama"


@pytest.mark.long
def test_invalid_value_shows_error_at_its_field(page: Page) -> None:
    open_form(page)
    page.get_by_label("Light samples").fill("70")
    page.get_by_label("Max depth", exact=True).fill("2.5")
    page.get_by_label("Samples per pixel").fill("")
    assert submitted_request(page) is None
    for sentence in ("Light samples lies between 1 and 64.", "Max depth is a whole number.", "Samples per pixel needs a number."):
        expect(page.get_by_role("alert").filter(has_text=sentence)).to_be_visible()
    expect(page.get_by_label("Samples per pixel")).to_be_focused()
    page.get_by_label("Samples per pixel").fill("8")
    page.get_by_label("Max depth", exact=True).fill("2")
    page.get_by_label("Light samples").fill("1")
    assert submitted_request(page)["spp"] == 8
