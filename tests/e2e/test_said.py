"""What the service says in English, as the page says it in another language."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page

from tests.e2e.site import Site, call

SAID = {
    # one that is as it stands, one with places, one that quotes another
    "Waits: all workers are paused.": "Wartet: Alle Worker sind angehalten.",
    "Waits for 3 jobs of a higher priority.": "Wartet auf 3 Jobs höherer Priorität.",
    "Waits: the film of this job is missing.": "Wartet: Der Film dieses Jobs fehlt.",
    "The picture's paths cannot be followed: the service is starting. Render it anew.": (
        "Die Pfade des Bildes lassen sich nicht verfolgen: Der Dienst startet. Neu rendern."
    ),
    # several, of which one is in no catalogue; a name ends with its sentence
    "There is no job 'none'. GET /api/jobs lists those that are there.": (
        "Einen Job 'none' gibt es nicht. GET /api/jobs führt auf, was es gibt."
    ),
    "The upload is empty. Nobody knows it. Send it again.": "Der Upload ist leer. Nobody knows it. Noch einmal senden.",
    # files by name, fields, halves, names that look like sentences
    "a. B.glb: ends inside its header; the upload or download was cut, take it again": (
        "a. B.glb: endet mitten im Kopf; Hoch- oder Herunterladen brach ab, noch einmal holen"
    ),
    "scene.mtl: its texture wood.png is not among the files; add it. Rendered in the base colour meanwhile.": (
        "scene.mtl: die Textur wood.png ist nicht unter den Dateien; hinzufügen. Bis dahin in der Grundfarbe gerendert."
    ),
    "x: width x height is 9 pixels; at most 8 are rendered": "x: Breite x Höhe sind 9 Pixel; höchstens 8 werden gerendert",
    "spp: needs is no such field.": "spp: needs is no such field.",
    # what readers say of many things of a file, how often, and how much of each
    "a.usd: Curves that are damaged are left out (2): /a, /b.": "a.usd: Beschädigte Kurven sind weggelassen (2): /a, /b.",
    "Lights of the kind Portal are left out (4): /a, /b, /c and others.": (
        "Lichter der Art Portal sind weggelassen (4): /a, /b, /c und andere."
    ),
    "a.pbrt, line 3: glass is as rough in both directions here (2 times)": (
        "a.pbrt, line 3: glass ist hier in beiden Richtungen gleich rau (2-mal)"
    ),
    "Not taken over as it is in the FBX file: 2 volume lights, 1 further skins of a mesh.": (
        "Nicht so übernommen, wie es in der FBX-Datei ist: 2 Volumenlichter, 1 weitere Skins eines Netzes."
    ),
    "Material oak: its texture oak.png is not among the files; add it. Rendered in the base colour meanwhile.": (
        "Material oak: die Textur oak.png ist nicht unter den Dateien; hinzufügen. Bis dahin in der Grundfarbe gerendert."
    ),
    # what nobody knows stays
    "Traceback (most recent call last): boom": "Traceback (most recent call last): boom",
    "<b>x</b> {n}": "<b>x</b> {n}",
    "": "",
}


@pytest.fixture
def german(browser: Browser, site: Site) -> Iterator[Page]:
    """An empty document on the page's origin, in a German browser."""
    context = browser.new_context(locale="de-DE")
    page = context.new_page()
    page.goto(f"{site.url}/blank")
    yield page
    context.close()


def test_sentences_of_the_service_are_put_together_in_german(german: Page) -> None:
    found = call(german, "base/said", "return a.map((each) => m.said(each));", list(SAID))
    assert dict(zip(SAID, found, strict=True)) == SAID


@pytest.mark.long
def test_what_the_service_refuses_is_told_in_german(german: Page) -> None:
    problem = '{"title": "Insufficient Storage", "detail": "The upload is empty. Send it again.", "status": 507}'
    assert call(german, "news/api", "return m.errorOf(507, a).message;", problem) == "Der Upload ist leer. Noch einmal senden."


@pytest.mark.long
def test_long_texts_and_deep_quotes_take_no_time(german: Page) -> None:
    """Patterns with several places, against texts that have their words many times: none goes back over what it has read."""
    body = "const begun = performance.now(); for (const each of a) m.said(each); return performance.now() - begun;"
    words = "The scene cannot be rendered: ", "a: ", "x; ", "No. ", "is (", " of the tile at "
    assert call(german, "base/said", body, [each * (3900 // len(each)) for each in words]) < 2000


@pytest.mark.long
def test_on_an_english_page_they_stay(page: Page) -> None:
    assert call(page, "base/said", "return a.map((each) => m.said(each));", list(SAID)) == list(SAID)
    assert call(page, "base/said", "return m.said(null);") == ""
