"""Tests of the page in all languages on a phone: headings are translated, no text is untranslated, and each view fits."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect

from tests.e2e.conftest import SOON_CLEAR
from tests.e2e.screen import render_job
from tests.helpers import ROOT, Farm
from tests.page.node import Node

HEADINGS = {
    "de-AT": ("Szene öffnen", "Rendern", "Speichern", "Jobs", "de"),
    "zh-CN": ("打开场景", "渲染", "保存", "作业", "zh-Hans"),
}
# The example scene's name, which is the same in every language.
NAME = "Spheres"
CODE = "mesh-vertices-not-finite"
PHONE: ViewportSize = {"width": 375, "height": 667}
TEXTS = "h1, h2, button, label, legend, summary, th, dt, nav a, option, .tabs *"


@pytest.fixture(scope="module")
def job(farm: Farm) -> str:
    """Returns the id of a small finished picture."""
    scene = httpx.post(f"{farm.url}/api/examples/spheres").raise_for_status().json()["id"]
    return render_job(farm, scene, width=32, height=24, spp=2)


@pytest.fixture(params=["de-AT", pytest.param("zh-CN", marks=pytest.mark.long)])
def foreign_page(browser: Browser, request: pytest.FixtureRequest) -> Iterator[tuple[Page, str]]:
    """Yields (page, locale) of a browser that is set to a language other than English."""
    context = browser.new_context(viewport=PHONE, reduced_motion="reduce", locale=request.param)
    context.set_default_timeout(20_000)
    context.add_init_script(SOON_CLEAR)
    yield context.new_page(), request.param
    context.close()


def assert_nothing_is_english(page: Page, locale: str) -> None:
    """Asserts that a view shows no English text for which the catalogue has a translation."""
    catalogue: dict[str, str] = json.loads((ROOT / "web" / "words" / f"{locale[:2]}.json").read_text(encoding="utf-8"))
    english = {key for key, text in catalogue.items() if key != text} - set(catalogue.values())
    shown = page.evaluate(
        """(selector) => [...document.querySelectorAll(selector)].flatMap((element) => element.closest("[translate=no]") ? [] : [
            element.textContent, element.title, element.getAttribute("aria-label") ?? "", element.placeholder ?? "",
            ...[...element.childNodes].map((node) => node.nodeValue ?? ""),
        ])""",
        TEXTS,
    )
    left = english & {text.strip() for text in shown} - {NAME}
    # Names of OpenColorIO views, as Raw, are those of the config in every language.
    views = {text.strip() for text in page.locator("optgroup option[value^='ocio:']").all_text_contents()}
    assert not left - views


def assert_fits_and_is_named(page: Page) -> None:
    """Asserts that a view is no wider than a phone's screen, and that every visible control and image has an accessible name."""
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll("button, a[href], input, select, textarea, img, [role=slider]")]
            .filter((element) => element.checkVisibility({ visibilityProperty: true }) && !element.closest("[aria-hidden=true]"))
            .filter((element) => !(element.ariaLabel || element.title || element.textContent.trim() || element.labels?.length
                || element.getAttribute("aria-labelledby") || element.placeholder || element.hasAttribute("alt")))
            .map((element) => element.outerHTML)"""
    )
    assert unnamed == []


def assert_is_fit(page: Page, locale: str) -> None:
    assert_nothing_is_english(page, locale)
    assert_fits_and_is_named(page)


def test_every_view_is_in_browser_language(farm: Farm, job: str, foreign_page: tuple[Page, str]) -> None:
    """On a phone, every view is in the browser's language and fits the screen, and its controls have accessible names."""
    page, locale = foreign_page
    drop, render, save, jobs, tag = HEADINGS[locale]
    page.goto(farm.url)
    expect(page.get_by_role("heading", name=drop)).to_be_visible()
    expect(page.locator("html")).to_have_attribute("lang", tag)
    assert_is_fit(page, locale)
    with farm.client() as client:
        scene = client.job(job).scene
    page.goto(f"{farm.url}/#/scenes/{scene}")
    expect(page.get_by_role("button", name=render, exact=True)).to_be_visible()
    assert_is_fit(page, locale)
    page.goto(f"{farm.url}/#/jobs/{job}")
    expect(page.get_by_role("tab", name=save, exact=True)).to_be_visible()
    assert_is_fit(page, locale)
    page.goto(f"{farm.url}/#/jobs")
    expect(page.get_by_role("heading", name=jobs, exact=True, level=1)).to_be_visible()
    expect(page.locator(".job-row").first).to_be_visible()
    assert_is_fit(page, locale)
    page.goto(f"{farm.url}/#/workers")
    expect(page.locator(".machine").first).to_be_visible()
    assert_is_fit(page, locale)
    page.locator(".more-button").click()
    assert_is_fit(page, locale)
    page.locator(".help-button").click()
    expect(page.locator("dialog.help a[href='docs/']")).to_be_visible()


@pytest.fixture(scope="module")
def scene_with_warning(farm: Farm) -> dict[str, Any]:
    """Uploads a scene with one invalid vertex, and returns its JSON, whose warning about the vertex contains a count."""
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\n"
    scene = httpx.post(f"{farm.url}/api/scenes", files={"files": ("odd.obj", vertices)}).raise_for_status().json()["id"]
    with farm.client() as client:
        client.wait_for_scene(scene)
    found: dict[str, Any] = httpx.get(f"{farm.url}/api/scenes/{scene}").raise_for_status().json()
    return found


def translated_warning(record: dict[str, Any], language: str) -> str:
    """Returns the warning's expected text in a language: the catalogue's template for its code, with its parameters inserted."""
    at, coded = next((i, each) for i, each in enumerate(record["codes"]["warnings"]) if each and each["code"] == CODE)
    assert record["warnings"][at].startswith("odd.obj: 1 vertices") and 1 in coded["params"].values()
    words = json.loads((ROOT / "web" / "words" / f"service.{language}.json").read_text(encoding="utf-8"))
    shown: str = words[coded["code"]]
    for name, value in coded["params"].items():
        shown = shown.replace(f"{{{name}}}", str(value))
    return shown


def test_reader_warning_is_translated_by_code(farm: Farm, scene_with_warning: dict[str, Any], program: str) -> None:
    """The page translates a scene reader's warning by the warning's code, and inserts the count.

    The warning passes from a worker through the service to the page's modules, run in Node.js. A problem response has a code too.
    """
    with Node(program, "de-DE") as node:
        shown = node.call("base/said", "return m.allSaidOf(a, 'warnings');", scene_with_warning)
    assert translated_warning(scene_with_warning, "de") in shown
    problem = httpx.get(f"{farm.url}/api/jobs/none").json()
    assert (problem["code"], problem["params"]) == ("job-not-found", {"id": "'none'"})
    assert problem["detail"].startswith("There is no job")


@pytest.mark.long
def test_warning_is_shown_in_browser_language(
    farm: Farm, scene_with_warning: dict[str, Any], foreign_page: tuple[Page, str]
) -> None:
    page, locale = foreign_page
    page.goto(f"{farm.url}/#/scenes/{scene_with_warning['id']}")
    expect(page.get_by_text(translated_warning(scene_with_warning, locale[:2])).first).to_be_visible()  # also in a list


@pytest.mark.long
def test_language_menu_changes_language_permanently(farm: Farm, foreign_page: tuple[Page, str]) -> None:
    page, locale = foreign_page
    page.goto(farm.url)
    expect(page.get_by_role("heading", name=HEADINGS[locale][0])).to_be_visible()
    page.locator(".more-button").click()
    page.locator(".language select").select_option("en")
    expect(page.get_by_role("heading", name="Open a scene")).to_be_visible()
    page.reload()
    expect(page.get_by_role("heading", name="Open a scene")).to_be_visible()
    expect(page.locator("html")).to_have_attribute("lang", "en")
