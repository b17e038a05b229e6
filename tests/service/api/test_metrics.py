"""Tests of Prometheus metrics: the values, and that the shipped alerts and dashboard query only existing ones."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest
import yaml

from tests.service.conftest import Service, until

MONITORING = Path(__file__).parents[3] / "deploy" / "monitoring"


def numbers(service: Service) -> dict[str, float]:
    lines = [line for line in service.http.get("/metrics").raise_for_status().text.splitlines() if not line.startswith("#")]
    return {name: float(value) for name, value in (line.rsplit(" ", 1) for line in lines)}


def test_alerts_and_dashboard_query_existing_metrics(service: Service) -> None:
    with service.worker():
        service.wait_for(service.submit(service.ready_scene()), "finished")
        told = {name.split("{")[0] for name in numbers(service)}
    rules = yaml.safe_load((MONITORING / "alerts.yml").read_text())["groups"][0]["rules"]
    board = json.loads((MONITORING / "grafana" / "dashboards" / "rayfarm.json").read_text())
    expressions = [rule["expr"] for rule in rules] + [one["expr"] for panel in board["panels"] for one in panel["targets"]]
    asked = {name for expression in expressions for name in re.findall(r"rayfarm_\w+", expression)}
    assert len(asked) >= 15
    assert asked <= told


@pytest.mark.long
def test_waiting_work_wants_slots_and_finished_work_none(service: Service) -> None:
    assert numbers(service)["rayfarm_slots_wanted"] == 0
    job = service.submit(service.upload())
    assert numbers(service)["rayfarm_slots_wanted"] >= 1
    with service.worker():
        service.wait_for(job, "finished")
        until(lambda: numbers(service)["rayfarm_slots_wanted"] == 0, "nothing is wanted")
        told = numbers(service)
        assert (told['rayfarm_slots{state="busy"}'], told['rayfarm_slots{state="idle"}']) == (0, 2)


@pytest.mark.long
def test_long_job_wants_slots_for_half_a_minute_each(service: Service) -> None:
    with service.worker() as worker:
        worker.on_batch = lambda batch: time.sleep(0.05)
        job = service.submit(service.ready_scene(), spp=60_000)
        until(lambda: numbers(service)["rayfarm_slots_wanted"] > 4, "many slots are wanted")
        service.patch(job, state="paused")
        until(lambda: numbers(service)["rayfarm_slots_wanted"] == 0, "a job that is paused wants none")
