"""Tests of a worker that miscalculates, in a real farm: it is detected and paused, and its samples are rendered again."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest

from renderer.child_processes import spawn_guard
from tests.chaos.test_digest import digest_without_farm, submit
from tests.helpers import ROOT, Farm, start_farm, stop_farm, wait_until

pytestmark = pytest.mark.long

LIAR = "faulty"
SPP = 160


def join(farm: Farm, ends: ExitStack, module: str, name: str) -> None:
    """Starts a worker with one slot, which is ended at the end of the test. module: Python module of the worker's program."""
    command = [sys.executable, "-m", module, "--service", farm.url, "--slots", "1", "--name", name]
    log = ends.enter_context((farm.data.parent / f"{name}.log").open("ab"))
    environment = {**os.environ, "RAYFARM_TOKEN": farm.token}
    process = subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=log, stderr=log, start_new_session=True, preexec_fn=spawn_guard()
    )
    ends.callback(process.wait)
    ends.callback(process.terminate)


def get(farm: Farm, path: str) -> Any:
    return httpx.get(farm.url + path, timeout=60).raise_for_status()


def test_a_machine_that_miscalculates_is_found_out_and_leaves_no_trace(tmp_path: Path) -> None:
    farm = start_farm(tmp_path / "data", 1, RAYFARM_BATCH_SECONDS="0.1")
    with ExitStack() as ends:
        ends.callback(stop_farm, farm)
        join(farm, ends, "worker", "honest")
        join(farm, ends, "tests.chaos.miscalculating", LIAR)

        def state(name: str) -> dict[str, Any]:
            return next((each for each in get(farm, "/api/workers").json() if each["name"] == name), {"state": "away"})

        wait_until(lambda: {state(name)["state"] for name in ("honest", LIAR)} == {"ready"}, 120, "all have joined")
        job = submit(farm, SPP, verify=1.0, tile_size=32)
        wait_until(lambda: state(LIAR)["state"] == "paused", 120, "it is found out")
        assert "Quarantined: its results differ from those of other workers" in str(state(LIAR))
        with farm.client() as client:
            final = client.wait(job, timeout_s=240)
            assert final.state == "finished", f"{final}\n{farm.logs()}"
            assert client.digest(job) == digest_without_farm(SPP)
        happened = get(farm, f"/api/jobs/{job}/history").json()["events"]
        assert any(LIAR in event["words"] for event in happened), happened
        log = get(farm, f"/api/jobs/{job}/log").text
        assert LIAR in log and "differently" in log, log
        assert {state(name)["state"] for name in ("honest",)} == {"ready"}
