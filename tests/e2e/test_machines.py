"""Tests of the machines page in a browser, with workers that only send reports."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest
import redis
from playwright.sync_api import Page, expect

from protocol.contract import WorkerReport, pause_key, worker_key
from protocol.vitals import Vitals, log_key, log_wanted_key, vitals_key
from renderer.sentences import Sentence, to_text
from tests.e2e.conftest import Watched
from tests.e2e.site import call
from tests.service.conftest import Service, until

OLD = f"{2001:020x}"  # a job unknown to the page


def say(store: redis.Redis, name: str, current: list[dict[str, Any]], **more: Any) -> None:
    report = WorkerReport(name, "host", 1, len(current), "A processor", "kind", "ready", time.time(), 1e6, current, **more)
    store.set(worker_key(name), report.to_bytes(), ex=60)


@pytest.mark.long
def test_machines_show_current_work_and_can_be_paused(many: Service, watched: Watched) -> None:
    page = watched.page
    with redis.Redis.from_url(many.options["redis_url"]) as store:
        batch = {"batch": "b", "job": OLD, "frame": 0, "tile": [64, 128, 64, 64], "first": 0, "count": 8}
        say(store, "alpha", [batch, {}])
        say(store, "beta", [{}])
        store.set(vitals_key("alpha"), Vitals(16_000_000_000, 64_000_000_000).to_bytes(), ex=60)
        reason = "Quarantined: {failures} of its batches failed while others rendered theirs. Check its log, then resume it."
        store.set(pause_key("beta"), to_text(Sentence("worker-quarantined-failures", reason, failures=3)))
        page.goto(f"{many.url}/#/workers")
        alpha, beta = (page.locator(".machine").filter(has_text=name) for name in ("alpha", "beta"))
        expect(alpha).to_contain_text("16 GB of 64 GB")
        expect(alpha.get_by_role("link", name="Milk truck take 2001")).to_be_visible()
        box = alpha.locator(".tile-box").first
        expect(box).to_have_attribute("style", "left: 10%; top: 35.5556%; width: 10%; height: 17.7778%;")
        expect(alpha.locator(".slot-tiles > li").last.get_by_text("Idle")).to_be_visible()
        expect(beta).to_contain_text("Quarantined: 3 of its batches failed")
        expect(beta.locator(".chip")).to_have_text("Quarantined")

        alpha.get_by_role("button", name="Pause").click()
        expect(alpha).to_contain_text("Draining")
        expect(alpha).to_contain_text("1 slot is finishing its current work.")
        say(store, "alpha", [{}, {}])
        expect(alpha.locator(".chip")).to_have_text("Paused")
        beta.get_by_role("button", name="Resume").click()
        expect(beta.locator(".chip")).to_have_text("Ready")
        until(lambda: not store.exists(pause_key("beta")), "it may take work again")

        alpha.get_by_text("Log").click()
        until(lambda: bool(store.exists(log_wanted_key("alpha"))), "the worker is asked")
        store.set(log_key("alpha"), json.dumps(["a line", "the last line"]), ex=60)
        expect(alpha.locator("pre")).to_have_text("a line\nthe last line")
        for name in ("alpha", "beta"):
            store.delete(worker_key(name), pause_key(name))
    assert watched.errors == []


@pytest.mark.long
def test_slot_shows_no_picture_of_another_job(page: Page) -> None:
    """A slot that starts another job shows no picture until that job's picture is loaded."""
    body = """
        const { jobs } = await import("/js/news/farm.js");
        jobs.set(["first", "second"].map((id) => ({ id, name: id, width: 8, height: 8, samples: 9 })));
        const { element, update } = m.machineCard();
        document.body.replaceChildren(element);
        const worker = { name: "a", cpu: "", state: "ready", slots: 1, terms: {} };
        const seen = [];
        for (const job of ["first", "first", "second", null, "second"]) {
            update({ ...worker, current: [job ? { job } : {}] });
            const image = element.querySelector(".slot-tiles img");
            seen.push([image.hidden, image.getAttribute("src")?.split("/")[2] ?? null]);
            image.dispatchEvent(new Event("load"));
        }
        return seen;"""
    of = [[True, "first"], [False, "first"], [True, "second"], [True, None], [True, "second"]]
    assert call(page, "views/machine", body) == of


def test_machine_shows_its_graphics_cards(page: Page) -> None:
    body = """
        const { element, update } = m.machineCard();
        document.body.replaceChildren(element);
        const worker = { name: "a", cpu: "", state: "ready", slots: 1, terms: {}, current: [{}] };
        const seen = [];
        for (const more of [
            {},
            { cards: [{ number: 0, name: "RTX Test", memory: 8 * 2 ** 30, slot: 0, samples_per_s: 2.5e8 }] },
            { cards: [], cards_unused: ["Card 1 is not used."] },
        ]) {
            update({ ...worker, ...more });
            const list = element.querySelector(".graphics-cards");
            seen.push([list.hidden, ...[...list.children].map((item) => item.textContent)]);
        }
        return seen;"""
    assert call(page, "views/machine", body) == [
        [True],
        [False, "Renders with card 0: RTX Test · 8 GiB · 250 M samples/s"],
        [False, "Card 1 is not used."],
    ]


def test_adding_a_machine_shows_commands_for_this_farm(page: Page) -> None:
    body = """
        const { session } = await import("/js/news/session.js");
        const commands = (joining) => [...m.addMachine(joining).querySelectorAll("code")].map(({ textContent }) => textContent);
        const start = "rayfarm up --port 9000 --host 0.0.0.0";
        const joining = { url: null, start, token: "T > NAME.token", here: "", program: "rayfarm" };
        const reached = { ...joining, url: "http://192.0.2.7:9000", start: null };
        const seen = [commands(joining), commands(reached)];
        session.set({ ...session.value, login: true });
        return [...seen, commands(reached)];"""
    assert call(page, "views/add-machine", body) == [
        ["rayfarm up --port 9000 --host 0.0.0.0"],
        ["T > NAME.token", "rayfarm worker --join http://192.0.2.7:9000 --token-file NAME.token"],
        ["RAYFARM_TOKEN=TOKEN rayfarm worker --join http://192.0.2.7:9000"],
    ]
