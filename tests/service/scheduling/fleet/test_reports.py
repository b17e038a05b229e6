"""Tests of workers' reports. Invalid numbers in one report affect neither the page nor the totals of other workers."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import pytest

from protocol.contract import WorkerReport, worker_key
from protocol.site import SiteReport
from protocol.terms import Offer
from service.scheduling.fleet.reports import report_of
from service.scheduling.fleet.speeds import Speeds
from service.scheduling.fleet.workers import FEW_WORKERS, WorkerSnapshot

REPORT: dict[str, Any] = asdict(WorkerReport("one", "host", 1, 2, "a processor", "kind", "ready", 0.0, 1e6, [{"batch": "b"}]))
CARD: dict[str, Any] = {"number": 0, "name": "RTX", "memory": 8 << 30, "capability": "8.6", "slot": 1, "samples_per_s": 1e8}
OFFER: dict[str, Any] = asdict(Offer(("tag",), 1 << 30, 2, "terms"))
SITE: dict[str, Any] = asdict(SiteReport("site", "host", 1, "10.0.0.1", 8010, 0.0))


def read(key: str, **changed: Any) -> WorkerReport:
    return report_of(worker_key(key).encode(), json.dumps({**REPORT, **changed}).encode())


def nested(levels: int) -> Any:
    return [nested(levels - 1)] if levels else []


@pytest.mark.parametrize(
    "changed",
    [
        {"samples_per_s": 1e308},
        {"samples_per_s": -1.0},
        {"slots": 5000},
        {"started": float("inf")},
        {"pid": 10**30},
        {"name": "two"},
        {"kind": "x" * 5000},
        {"cpu": "a\0b"},
        {"current": [{}] * 5000},
        {"current": [{"frame": 10**400}]},
        {"current": [{"first": float("inf")}]},
        {"current": [{"tile": [float("nan")]}]},
        {"current": [{"job": "a\0b"}]},
        {"current": [{"job": "x" * 5000}]},
        {"current": [{"tile": nested(40)}]},
        {"cards": [CARD] * 65},
        {"cards": [{}]},
        *({"cards": [{**CARD, **wrong}]} for wrong in ({"name": 3}, {"memory": -1}, {"slot": None}, {"samples_per_s": 1e13})),
        {"cards_unused": ["x" * 5000]},
    ],
    ids=lambda changed: str(changed)[:60],
)
def test_invalid_report_is_rejected(changed: dict[str, Any]) -> None:
    assert read("one").slots == 2
    with pytest.raises(ValueError):
        read("one", **changed)


def test_report_contains_graphics_cards() -> None:
    assert read("one", cards=[CARD], cards_unused=["A reason."]).cards == [CARD]


@pytest.mark.parametrize("name", ["", "a\nb", "x" * 201])
def test_unprintable_worker_name_is_rejected(name: str) -> None:
    with pytest.raises(ValueError):
        read(name, name=name)


def test_infinite_number_in_exponent_notation_is_rejected() -> None:
    text = json.dumps({**REPORT, "current": [{"first": 12345}]}).replace("12345", "1e999")
    with pytest.raises(ValueError):
        report_of(worker_key("one").encode(), text.encode())


def test_largest_accepted_speeds_can_be_summed() -> None:
    speeds = Speeds(now=0.0)
    for second in range(20):
        speeds.add_reports([read("one", samples_per_s=1e12, slots=4096, current=[{"batch": "b"}] * 4096)], now=float(second))
    assert all(speed > 0 for speed in speeds.speeds_by_worker["one"])


@pytest.mark.parametrize(
    ("of", "good", "changed"),
    [
        (Offer.from_bytes, OFFER, {"memory": 1.5}),
        (Offer.from_bytes, OFFER, {"memory": -1}),
        (Offer.from_bytes, OFFER, {"slots_most": float("nan")}),
        (Offer.from_bytes, OFFER, {"idle_minutes": float("nan")}),
        (Offer.from_bytes, OFFER, {"idle_minutes": float("inf")}),
        (Offer.from_bytes, OFFER, {"nice": 10**30}),
        (Offer.from_bytes, OFFER, {"tags": ["x"] * 2000}),
        (Offer.from_bytes, OFFER, {"hours": "x" * 5000}),
        (SiteReport.from_bytes, SITE, {"results": 1.5}),
        (SiteReport.from_bytes, SITE, {"bytes_in": -1}),
        (SiteReport.from_bytes, SITE, {"started": float("nan")}),
    ],
    ids=lambda value: str(value)[:40],
)
def test_offers_and_vitals_reject_invalid_numbers(
    of: Callable[[bytes], Any], good: dict[str, Any], changed: dict[str, Any]
) -> None:
    of(json.dumps(good).encode())
    with pytest.raises(ValueError):
        of(json.dumps({**good, **changed}).encode())


def test_negative_nice_level_is_accepted() -> None:
    assert Offer.from_bytes(json.dumps({**OFFER, "nice": -20}).encode()).nice == -20
    with pytest.raises(ValueError):
        Offer.from_bytes(json.dumps({**OFFER, "nice": -21}).encode())


def test_starting_worker_is_polled_more_often() -> None:
    def about_to_change(*states: str) -> bool:
        return WorkerSnapshot(
            {str(i): read(str(i), name=str(i), state=state) for i, state in enumerate(states)}
        ).is_about_to_change()

    assert about_to_change()
    assert about_to_change("paused")
    assert not about_to_change("ready", "paused")
    assert about_to_change("ready", "starting")
    assert not about_to_change(*["ready"] * FEW_WORKERS, "starting"), "to look at many takes long"
